"""What is made of analyses: energy, limits, the paper's band, published values, noise models
compared, the reanalysis.

Read `reanalysis` first.
"""
