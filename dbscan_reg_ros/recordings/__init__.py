"""Recordings on disk: scans, odometry and truth, whatever the format."""
from .recording import Recording, open_recording

__all__ = ['Recording', 'open_recording']
