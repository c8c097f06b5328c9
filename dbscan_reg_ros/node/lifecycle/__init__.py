# SPDX-License-Identifier: Apache-2.0
"""Process of a node from start to end, the spinning of its executor, and the lifecycle node."""
