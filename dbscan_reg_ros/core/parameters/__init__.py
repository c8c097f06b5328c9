# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the method: default, unit, bounds and help, in one place."""
