"""Tests with the emulated node as a process of its own."""
