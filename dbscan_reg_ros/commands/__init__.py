# SPDX-License-Identifier: Apache-2.0
"""Commands of the command line: one module for each command, with ``main(argv=None) -> int``."""
