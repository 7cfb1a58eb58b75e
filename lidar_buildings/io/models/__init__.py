"""City models: CityJSON, OBJ, DXF."""
