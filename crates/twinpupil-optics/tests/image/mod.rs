//! Wavefronts, images of points and contrast, against closed forms, Seidel's sums and another program.

mod closed_forms;
mod other_programs;
