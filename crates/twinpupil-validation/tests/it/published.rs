//! [Ohno2018]: what its equations give for the simulated dots, Figs. 3 and 4.
//!
//! Claim: dots at r = 2 come out short before focus and long behind it, since the two masks clip each other near the
//! axis; at r = 7.5 the equations are right. Two independent programs give 247.1, 297.5 and 355.25 for z = 250, 300
//! and 350 at r = 2.

use twinpupil_instrument::paper;
use twinpupil_reconstruct::Mode;
use twinpupil_validation::rig::Rig;
use twinpupil_validation::rings::{PAPER_PLACES, depths};

/// The two programs agree to this, mm.
const INNER_TOLERANCE_MM: f64 = 0.15;

/// What the extent of a dot leaves at r = 7.5, mm.
const OUTER_TOLERANCE_MM: f64 = 0.06;

#[test]
fn the_papers_equations_give_what_two_other_programs_give() {
    let rig = Rig::new(paper::instrument(), Mode::Paper);
    for (z_mm, inner_mm) in [(250.0, 247.1), (300.0, 297.5), (350.0, 355.25)] {
        for depth in depths(&rig, &PAPER_PLACES, z_mm) {
            let found_mm = depth.found_mm.expect("every dot is found");
            let (expected_mm, tolerance_mm) =
                if depth.r_mm < 3.0 { (inner_mm, INNER_TOLERANCE_MM) } else { (z_mm, OUTER_TOLERANCE_MM) };
            assert!((found_mm - expected_mm).abs() < tolerance_mm, "r = {}: {found_mm} for {z_mm}", depth.r_mm);
        }
    }
}
