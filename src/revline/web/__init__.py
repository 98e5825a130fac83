"""The workbench: the whole chain live in a browser, and over HTTP for programs."""
