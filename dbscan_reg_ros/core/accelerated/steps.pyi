# SPDX-License-Identifier: Apache-2.0
"""Types of the compiled steps: those of the reference."""
from ..registration.point_to_line import fit as fit
from ..registration.point_to_line import refine as refine

SOURCE_HASH: str
STEPS: tuple[str, ...]
