//! `features.csv` and `rejected.csv`: what was found in each band, and what was not used and why.

use twinpupil_reconstruct::{Feature, Rejection};

use super::table::{Cells, Table};

/// Decimals of positions in px.
const PX_DECIMALS: usize = 6;
/// Decimals of areas in square px.
const AREA_DECIMALS: usize = 1;

/// The features of one band of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct BandFeatures {
    /// The frame's file.
    pub frame: String,
    /// Name of the band.
    pub band: String,
    /// Its features; their index is their id.
    pub features: Vec<Feature>,
}

/// The table of all features, with a column `frame` where `several_frames`.
pub fn table(bands: &[BandFeatures], several_frames: bool) -> Table {
    let features = || bands.iter().flat_map(|band| &band.features);
    let real = |decimals, value: fn(&Feature) -> f64| Cells::Real(features().map(value).collect(), decimals);
    let label = |name: fn(&BandFeatures) -> &String| {
        Cells::Label(bands.iter().flat_map(|band| band.features.iter().map(|_| name(band).clone())).collect())
    };
    let table = Table::new()
        .with("band", label(|band| &band.band))
        .with("id", Cells::Whole(bands.iter().flat_map(|band| 0..band.features.len() as i64).collect()))
        .with("u_px", real(PX_DECIMALS, |feature| feature.centre.u))
        .with("v_px", real(PX_DECIMALS, |feature| feature.centre.v))
        .with("u_std_px", real(PX_DECIMALS, |feature| feature.centre_std_px[0]))
        .with("v_std_px", real(PX_DECIMALS, |feature| feature.centre_std_px[1]))
        .with("area_px", real(AREA_DECIMALS, |feature| feature.area_px))
        .with("height_codes", real(AREA_DECIMALS, |feature| feature.height_codes))
        .with("overlapped", Cells::Flag(features().map(|feature| feature.overlapped).collect()));
    if several_frames { table.with("frame", label(|band| &band.frame)) } else { table }
}

/// The rejected features of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameRejections {
    /// The frame's file.
    pub frame: String,
    /// What was not used.
    pub rejected: Vec<Rejection>,
}

/// The table of all rejected features, with a column `frame` where there are several.
pub fn rejected_table(frames: &[FrameRejections]) -> Table {
    let rejected = || frames.iter().flat_map(|frame| &frame.rejected);
    let real = |decimals, value: fn(&Rejection) -> f64| Cells::Real(rejected().map(value).collect(), decimals);
    let table = Table::new()
        .with("band", Cells::Label(rejected().map(|rejection| rejection.band.clone()).collect()))
        .with("u_px", real(PX_DECIMALS, |rejection| rejection.position.u))
        .with("v_px", real(PX_DECIMALS, |rejection| rejection.position.v))
        .with("area_px", real(AREA_DECIMALS, |rejection| rejection.area_px))
        .with("reason", Cells::Label(rejected().map(|rejection| rejection.reason.name().to_owned()).collect()));
    if frames.len() < 2 {
        return table;
    }
    let names = frames.iter().flat_map(|frame| frame.rejected.iter().map(|_| frame.frame.clone())).collect();
    table.with("frame", Cells::Label(names))
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::PixelPoint;
    use twinpupil_reconstruct::RejectionReason;

    use super::*;

    #[test]
    fn the_headers_are_the_contract() {
        let text = |table: Table| String::from_utf8(table.to_csv()).expect("text");
        assert!(text(table(&[], false)).starts_with("band,id,u_px,v_px,u_std_px,v_std_px,area_px,"));
        assert!(text(table(&[], true)).ends_with(",frame\n"));
        let rejection = Rejection {
            band: "red".to_owned(),
            position: PixelPoint { u: 1.0, v: f64::NAN },
            area_px: 12.0,
            reason: RejectionReason::CutByBorder,
        };
        let frame = FrameRejections { frame: "a.png".to_owned(), rejected: vec![rejection] };
        let expected = "band,u_px,v_px,area_px,reason\nred,1.000000,,12.0,cut_by_border\n";
        assert_eq!(text(rejected_table(&[frame])), expected);
    }
}
