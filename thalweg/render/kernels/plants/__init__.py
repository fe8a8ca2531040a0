"""Kernels that draw plants as billboards, with colours or as coverage."""
