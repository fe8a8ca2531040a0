"""Tests of single flights, without a server."""
