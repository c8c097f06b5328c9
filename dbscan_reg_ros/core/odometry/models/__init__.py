# SPDX-License-Identifier: Apache-2.0
"""Models of motion, time, covariance, wheels and heading, one a module."""
