"""Why a map is wrong."""
