"""What is measured: windows of scene folders and data sets, Gaussian files, and scenes that are made."""
