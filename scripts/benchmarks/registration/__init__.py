# SPDX-License-Identifier: Apache-2.0
"""Registration of two scans: rates, errors, times and covariances."""
