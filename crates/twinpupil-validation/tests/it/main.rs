//! Expected values come from the paper, from closed forms and from other people's programs; never from ourselves.

mod accuracy;
mod askew;
mod calibration;
mod carriers;
mod damaged;
mod limit;
mod published;
mod real_disks;
mod real_lens;
mod scenes;
mod strangers;
