"""The networks: the front's U-Net, the back's generator and its judge, and VGG19's features."""
