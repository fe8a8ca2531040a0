"""Tests of the adapters, and of other libraries with them; docs/other-libraries.md says which versions."""
