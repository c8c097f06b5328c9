# SPDX-License-Identifier: Apache-2.0
"""The literal method of Liu et al., "Laser Radar Data Registration Algorithm Based on DBSCAN Clustering" (2023).

Electronics 12(6), 1373, https://doi.org/10.3390/electronics12061373. `pipeline.register` is Figure 13, step by step.
The paper does not give all values: what is open is a constant with the word "Open" beside its use. The open values were
chosen on 50 scans of 180 beams, as the best of about a thousand settings (doc/paper.md). They may not suit other
lidars.
"""
