//! Rays through a coaxial two-aperture camera.
