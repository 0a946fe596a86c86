//! Plots: as SVG that sits in a page, where axes and text take the page's own colour, or as drawings for files; series have
//! those of [`Colour`].

use std::sync::Arc;

use kuva::backend::svg::SvgBackend;
use kuva::plot::legend::{LegendEntry, LegendPosition, LegendShape};
use kuva::plot::{BandPlot, LinePlot, ScatterPlot};
use kuva::render::layout::{Layout, TickFormat};
use kuva::render::plots::Plot;
use kuva::render::render::{Scene, render_multiple};
use kuva::render::theme::Theme;

use crate::drawing::{Drawing, INK, scalable};

/// Width and height of a plot in its own units; the page scales it.
const SIZE: [f64; 2] = [540.0, 380.0];
/// Radius of a marker.
const MARKER: f64 = 3.5;
/// That of one among many.
const FAINT_MARKER: f64 = 1.8;

/// Colours that stay apart under every common colour blindness  [Okabe and Ito 2008].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// The telecentric band, and what is measured.
    Vermilion,
    /// The entocentric band, and what is simulated.
    Blue,
    /// A second measurement.
    Green,
    /// A third measurement.
    Orange,
    /// A fourth measurement.
    Purple,
    /// The ideal: readable on light and on dark.
    Grey,
    /// What is drawn over pictures.
    White,
}

impl Colour {
    /// Those of series, in the order in which they are used.
    pub const SERIES: [Self; 5] = [Self::Blue, Self::Vermilion, Self::Green, Self::Orange, Self::Purple];

    /// As CSS.
    pub fn css(self) -> &'static str {
        match self {
            Self::Vermilion => "#d55e00",
            Self::Blue => "#0072b2",
            Self::Green => "#009e73",
            Self::Orange => "#e69f00",
            Self::Purple => "#cc79a7",
            Self::Grey => "#888888",
            Self::White => "#ffffff",
        }
    }
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// Through.
    Solid,
    /// Broken.
    Dashed,
}

/// A point with the half length of its vertical error bar, where it has one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlotPoint {
    /// Abscissa.
    pub x: f64,
    /// Ordinate.
    pub y: f64,
    /// Half length of the error bar; 0 for none.
    pub y_error: f64,
}

impl From<[f64; 2]> for PlotPoint {
    fn from([x, y]: [f64; 2]) -> Self {
        Self { x, y, y_error: 0.0 }
    }
}

/// A plot in the making.
pub struct Chart {
    x_label: String,
    y_label: String,
    plots: Vec<Plot>,
    legend: Vec<LegendEntry>,
    x_range: Option<[f64; 2]>,
    y_range: Option<[f64; 2]>,
    size: [f64; 2],
    equal_scales: bool,
    log_x: bool,
    log_y: bool,
}

impl Chart {
    /// An empty plot; the labels carry the units.
    pub fn new(x_label: &str, y_label: &str) -> Self {
        Self {
            x_label: x_label.to_owned(),
            y_label: y_label.to_owned(),
            plots: Vec::new(),
            legend: Vec::new(),
            x_range: None,
            y_range: None,
            size: SIZE,
            equal_scales: false,
            log_x: false,
            log_y: false,
        }
    }

    /// Adds markers, with error bars where there are errors. An empty name stays out of the legend; points that are not
    /// finite are left out.
    pub fn points(mut self, name: &str, colour: Colour, points: &[PlotPoint]) -> Self {
        let drawn: Vec<&PlotPoint> = points.iter().filter(|point| point.x.is_finite() && point.y.is_finite()).collect();
        if !drawn.is_empty() {
            let mut scatter = ScatterPlot::new()
                .with_data(drawn.iter().map(|point| (point.x, point.y)))
                .with_color(colour.css())
                .with_size(MARKER)
                .with_marker_opacity(0.75);
            if drawn.iter().any(|point| point.y_error > 0.0) {
                scatter = scatter.with_y_err(drawn.iter().map(|point| finite_or_zero(point.y_error)));
            }
            self.plots.push(Plot::Scatter(scatter));
        }
        self.entry(name, colour, LegendShape::Circle, Stroke::Solid);
        self
    }

    /// Adds many small faint markers, so that what they have in common stands out. They stay out of the legend; points
    /// that are not finite are left out.
    pub fn cloud(mut self, colour: Colour, points: &[[f64; 2]]) -> Self {
        let finite = points.iter().filter(|[x, y]| x.is_finite() && y.is_finite());
        let drawn: Vec<(f64, f64)> = finite.map(|&[x, y]| (x, y)).collect();
        if !drawn.is_empty() {
            let scatter = ScatterPlot::new().with_data(drawn).with_color(colour.css());
            self.plots.push(Plot::Scatter(scatter.with_size(FAINT_MARKER).with_marker_opacity(0.3)));
        }
        self
    }

    /// Adds a line through points. An empty name stays out of the legend.
    pub fn line(mut self, name: &str, colour: Colour, stroke: Stroke, points: &[[f64; 2]]) -> Self {
        let finite = points.iter().filter(|[x, y]| x.is_finite() && y.is_finite());
        let drawn: Vec<(f64, f64)> = finite.map(|&[x, y]| (x, y)).collect();
        if !drawn.is_empty() {
            let line = LinePlot::new().with_data(drawn).with_color(colour.css()).with_stroke_width(2.0);
            self.plots.push(Plot::Line(if stroke == Stroke::Dashed { line.with_dashed() } else { line }));
        }
        self.entry(name, colour, LegendShape::Line, stroke);
        self
    }

    /// Adds a shaded band between two ordinates over a range of abscissae. An empty name stays out of the legend.
    pub fn band(mut self, name: &str, colour: Colour, x: [f64; 2], y: [f64; 2]) -> Self {
        if x.iter().chain(&y).all(|value| value.is_finite()) {
            let band = BandPlot::new(x, [y[0]; 2], [y[1]; 2]).with_color(colour.css()).with_opacity(0.18);
            self.plots.push(Plot::Band(band));
        }
        self.entry(name, colour, LegendShape::Rect, Stroke::Solid);
        self
    }

    /// Fixes the horizontal range.
    pub fn x_range(mut self, min: f64, max: f64) -> Self {
        self.x_range = Some([min, max]);
        self
    }

    /// Fixes the vertical range.
    pub fn y_range(mut self, min: f64, max: f64) -> Self {
        self.y_range = Some([min, max]);
        self
    }

    /// Makes the horizontal axis logarithmic: abscissae must be above zero.
    pub fn log_x(mut self) -> Self {
        self.log_x = true;
        self
    }

    /// Makes the vertical axis logarithmic: ordinates must be above zero.
    pub fn log_y(mut self) -> Self {
        self.log_y = true;
        self
    }

    /// Draws a unit as long across as up, on a square.
    pub fn equal_scales(mut self) -> Self {
        self.size = [SIZE[0], SIZE[0]];
        self.equal_scales = true;
        self
    }

    /// The plot, for a page.
    pub fn into_svg(self) -> String {
        scalable(&SvgBackend::new().render_scene(&self.into_scene("currentColor", "#88888840")))
    }

    /// The plot, for a file.
    pub fn into_drawing(self) -> Drawing {
        Drawing::of(self.into_scene(INK, "#e1e1e1"))
    }

    fn into_scene(mut self, ink: &str, grid: &str) -> Scene {
        let mut plots = std::mem::take(&mut self.plots);
        if plots.is_empty() {
            // Axes need something to range over.
            plots.push(Plot::Scatter(ScatterPlot::new().with_data([(0.0, 0.0), (1.0, 1.0)]).with_color("none")));
        }
        let layout = self.into_layout(&plots, theme(ink, grid));
        render_multiple(plots, layout)
    }

    fn into_layout(self, plots: &[Plot], theme: Theme) -> Layout {
        let mut layout = Layout::auto_from_plots(plots)
            .with_width(self.size[0])
            .with_height(self.size[1])
            .with_x_label(self.x_label.as_str())
            .with_y_label(self.y_label.as_str())
            .with_theme(theme)
            .with_label_size(14)
            .with_tick_size(12)
            .with_body_size(12);
        if let Some([min, max]) = self.x_range {
            layout = layout.with_x_axis_min(min).with_x_axis_max(max);
        }
        if let Some([min, max]) = self.y_range {
            layout = layout.with_y_axis_min(min).with_y_axis_max(max);
        }
        if self.log_x {
            layout = layout.with_log_x().with_x_tick_format(TickFormat::Custom(Arc::new(plain)));
        }
        if self.log_y {
            layout = layout.with_log_y().with_y_tick_format(TickFormat::Custom(Arc::new(plain)));
        }
        if self.equal_scales {
            layout = layout.with_equal_aspect();
        }
        if !self.legend.is_empty() {
            layout = layout
                .with_legend_entries(self.legend)
                .with_legend_position(LegendPosition::OutsideBottomColumns)
                .with_legend_box(false);
        }
        layout
    }

    fn entry(&mut self, name: &str, colour: Colour, shape: LegendShape, stroke: Stroke) {
        if !name.is_empty() {
            let dasharray = (stroke == Stroke::Dashed).then(|| "6 4".to_owned());
            self.legend.push(LegendEntry { label: name.to_owned(), color: colour.css().to_owned(), shape, dasharray });
        }
    }
}

fn finite_or_zero(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

/// A number of a logarithmic axis, which has one digit: 0.05, 0.1 and 20, not 0.050, 1e-1 and 20.
fn plain(number: f64) -> String {
    if !(1e-4..1e5).contains(&number) {
        return format!("{number:e}");
    }
    let decimals = (-number.log10().floor()).max(0.0) as usize;
    format!("{number:.decimals$}")
}

/// No background, and one colour for everything that is not a series, but for the grid.
fn theme(ink: &str, grid: &str) -> Theme {
    let ink = || ink.to_owned();
    Theme {
        background: "none".to_owned(),
        axis_color: ink(),
        grid_color: grid.to_owned(),
        tick_color: ink(),
        text_color: ink(),
        legend_bg: "none".to_owned(),
        legend_border: "none".to_owned(),
        font_family: Some("system-ui, sans-serif".to_owned()),
        ..Theme::light()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degenerate_data_still_make_a_plot() {
        let nan = [f64::NAN, 1.0];
        let one = [[1.0, 1.0]];
        for chart in [
            Chart::new("x", "y"),
            Chart::new("x", "y").points("none", Colour::Blue, &[nan.into()]).line("", Colour::Blue, Stroke::Solid, &[]),
            Chart::new("x", "y").line("one", Colour::Blue, Stroke::Dashed, &one),
            Chart::new("x", "y").points("one", Colour::Blue, &one.map(PlotPoint::from)),
            Chart::new("x", "y").cloud(Colour::Blue, &[nan, nan]),
            Chart::new("x", "y").band("none", Colour::Grey, [0.0, f64::NAN], [0.0, 1.0]),
        ] {
            let svg = chart.into_svg();
            assert!(svg.starts_with("<svg") && svg.contains("viewBox") && !svg.contains("NaN"), "{svg}");
        }
    }

    #[test]
    fn logarithmic_axes_have_plain_numbers() {
        assert_eq!(
            [0.001, 0.02, 0.1, 0.5, 1.0, 20.0, 1e6].map(plain),
            ["0.001", "0.02", "0.1", "0.5", "1", "20", "1e6"]
        );
        let svg =
            Chart::new("x", "y").log_x().line("", Colour::Blue, Stroke::Solid, &[[0.02, 1.0], [5.0, 2.0]]).into_svg();
        assert!([">0.05<", ">0.1<", ">2<"].iter().all(|label| svg.contains(label)), "{svg}");
    }

    #[test]
    fn text_is_escaped() {
        let svg = Chart::new("a < b & c", "y").into_svg();
        assert!(svg.contains("a &lt; b &amp; c"));
    }
}
