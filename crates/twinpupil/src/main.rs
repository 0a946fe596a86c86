//! `twinpupil`.
fn main() {}
