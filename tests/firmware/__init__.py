"""The firmware on emulated boards."""
