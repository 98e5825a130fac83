"""Physics of engines as parts and assemblies."""
