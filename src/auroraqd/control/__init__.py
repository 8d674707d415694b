"""Control: when the descriptor is refitted, what an update may change, and how l follows the descriptors."""
