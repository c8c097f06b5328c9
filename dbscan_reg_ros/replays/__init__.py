# SPDX-License-Identifier: Apache-2.0
"""The odometry of a recording, offline: the way it finds, and what is written of it."""
