"""GGX: isotropic and anisotropic, compensation of multiple scattering."""
