//! The page that shows what a calibration comes to.

mod correlations;
mod measured;
pub mod page;
mod plots;
mod residuals;
