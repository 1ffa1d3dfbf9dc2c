"""Validation of an installation: closed forms, classical formulations and hard inputs."""
