# SPDX-License-Identifier: Apache-2.0
"""Names of the methods that can be compared; importing this module loads none of the methods."""

METHODS = ('dbscan', 'paper', 'small_gicp', 'kiss-icp', 'icp', 'idc', 'icl', 'identity')
