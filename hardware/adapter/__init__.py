"""The real robot: Robstride motors behind the `Robot` protocol, verified before they are enabled and watched after."""
