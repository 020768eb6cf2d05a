"""The pytest plugin for those who build on labanmesh: a mesh, a fusion service and observers in the test's process."""
