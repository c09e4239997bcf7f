"""What every room uses: poses, transforms, scans, velocities, conversions of messages, errors."""
