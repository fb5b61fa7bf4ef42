"""What is measured: windows of scene folders and data sets, and scenes and Gaussians that are made."""
