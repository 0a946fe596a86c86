//! Files: the one place of the workspace that reads and writes them.
//!
//! Whatever is written is encoded in memory first and reaches its path in one rename ([`output`]), so a failed command
//! leaves nothing half-written. Every error is one sentence that starts with the path.

pub mod envi;
pub mod features;
pub mod files;
pub mod folder;
pub mod frame;
pub mod input;
pub mod lens;
pub mod output;
pub mod page;
mod parquet;
pub mod pieces;
mod ply;
mod png;
pub mod points;
pub mod read_table;
pub mod shard;
pub mod stage;
pub mod table;
mod tiff;
pub mod truth;

pub use self::png::encode_rgb8;
pub use self::tiff::encode_tiff_f32;
