"""Files: LAS/LAZ/COPC in; classified LAZ, GeoPackage, CityJSON out."""
