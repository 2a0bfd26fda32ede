"""From artifacts to people and tests: Rerun recordings, exports, pictures, comparisons."""
