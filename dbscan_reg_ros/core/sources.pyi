# SPDX-License-Identifier: Apache-2.0
"""The sources that the compiled modules were built from."""

SOURCE_HASH: str
