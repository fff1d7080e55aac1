"""Identification of sites, moments and vehicles across recordings, by geometry and motion."""
