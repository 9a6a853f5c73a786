"""Elements, their points of integration, traces and compiled forms."""
