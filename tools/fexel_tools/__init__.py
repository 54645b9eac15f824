"""Authoring tools of fexel and its command line; heavier dependencies than the plugin's."""
