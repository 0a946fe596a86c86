//! Rays through lenses that are given surface by surface, against other programs and against what must hold of any lens.

mod damaged;
mod double_gauss;
mod lens_file;
mod other_programs;
mod properties;
mod published;
mod zmx;
