"""Audit three papers: check every printed statement by computation, and run the example of one paper again.

- Yuan & Ge 2016: Yuan Pingping, Ge Xinsheng, Application of least square method in solving Gauss constraint function, Journal of
  Dynamics and Control, DOI 10.6052/1672-6553-2016-003.
- Wang et al. 2010: Wang Chengzhi, Huang Kaixuan, Zhang Quanming, Fang Fang, Automated modeling for kinematic analysis of planar
  linkages based on link units, Trans. CSAM 41(2), DOI 10.3969/j.issn.1000-1298.2010.02.043.
- Men et al. 2009: Men Yubin, Feng Jian, He Jun, General simulation software of planar linkages based on geometric constraints,
  J. Mechanical Transmission 33(4).
"""
