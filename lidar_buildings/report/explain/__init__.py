"""Why a building has this outline and this roof, from what the result folder holds."""
