# SPDX-License-Identifier: Apache-2.0
"""Error measures of trajectories, other methods of registration and odometry, and comparisons of methods."""
