"""Tests of the page to fly: its flights, its server, and the page in a browser."""
