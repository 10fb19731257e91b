"""Pictures of intermediate data; nothing imports this package."""
