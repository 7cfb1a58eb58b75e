"""What points form together: triangulations, planes, eigenvalues, rasters, intensities."""
