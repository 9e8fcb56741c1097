"""What a folder of measurements can tell, and which measurement to make next; nothing here fits."""
