//! Many cameras of one design, each off its drawing by what its parts may be off by: how well they measure depth, as drawn
//! and calibrated, and what it is that spoils it.

mod built;
mod element;
mod outcome;
mod run;
mod sight;
mod source;
mod tolerances;
mod trial;
mod volume;

pub use built::{Built, Drawing};
pub use element::Element;
pub use outcome::{Contributor, Errors, Outcome, quantile};
pub use run::{Kind, Row, Run, RunSpec};
pub use sight::{Leak, Reader, Sight};
pub use source::{Source, Toleranced};
pub use tolerances::{Distribution, GRADES, Temperature, Tolerances, grade};
pub use trial::{Reading, Trial};
pub use volume::Volume;
