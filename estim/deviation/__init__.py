"""What the curve lacks, as covariance: an unmodelled force along a track, a deviation of any curve, errors that are correlated in time.

Read `components` first, then `force`.  Takes arrays (covariances, residuals, Jacobians), no noise models.  Imports `common` alone."""
