"""The dashboard: a scene, or a capture of one, as a read-only page in the browser (docs/guide/dashboard.md)."""
