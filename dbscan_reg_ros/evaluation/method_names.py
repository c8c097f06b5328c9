# SPDX-License-Identifier: Apache-2.0
"""Names of the methods that can be compared, without loading any of them."""

METHODS = ('dbscan', 'paper', 'small_gicp', 'kiss-icp', 'icp', 'idc', 'icl', 'identity')
