//! Many scores as a table.

use std::fmt::Write;

use sagci_furniture::Category;
use serde::Serialize;

use super::PerceptionOptions;
use super::score::{Mask, Opening, PartScore, Scored};

/// The paper's "init" column: AP75, type accuracy, axis in degrees, place.
const PAPER: [(&str, [f64; 4]); 7] = [
    ("door", [0.748, 0.975, 13.713, 15.806]),
    ("microwave", [0.800, 1.000, 11.562, 15.439]),
    ("box", [0.895, 0.877, 10.143, 15.241]),
    ("oven", [0.773, 1.000, 23.525, 18.731]),
    ("refrigerator", [0.584, 0.989, 12.174, 18.000]),
    ("storage", [0.499, 0.924, 11.564, 33.510]),
    ("overall", [0.717, 0.961, 13.780, 19.455]),
];

/// Figures of some clouds or parts. Shares from 0 to 1, degrees, cm; `null` where nothing was there to measure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PerceptionRow {
    /// A category, a joint state, or overall.
    pub name: String,
    /// Clouds.
    pub clouds: usize,
    /// True moving parts that could be seen.
    pub parts: usize,
    /// Mean intersection over union of true parts, the body among them.
    pub miou: f64,
    /// Average precision at an overlap of .5, all parts.
    pub ap50: f64,
    /// At .75.
    pub ap75: f64,
    /// Mean over .5 to .95.
    pub map: f64,
    /// Average precision at .75 of moving parts alone.
    pub ap75_moving: f64,
    /// Right types among found parts.
    pub type_accuracy: f64,
    /// Mean angle between axes, degrees.
    pub axis_mean: f64,
    /// Median.
    pub axis_median: f64,
    /// Mean distance from line to line, cm.
    pub line_mean: f64,
    /// Median.
    pub line_median: f64,
    /// Mean distance from the true origin to the line, cm.
    pub place_mean: f64,
    /// Median.
    pub place_median: f64,
    /// Mean of the same, % of the object's diagonal.
    pub place_percent: f64,
    /// Found, of the right type, less than 5 degrees and 5 cm off.
    pub end_to_end: f64,
    /// Joints that are none, a cloud.
    pub false_joints: f64,
    /// The paper's AP75, type accuracy, axis and place before interaction.
    pub paper: Option<[f64; 4]>,
}

/// All figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PerceptionTable {
    /// Version of this layout.
    pub schema: u32,
    /// What was drawn.
    pub seed: u64,
    /// Were the families held out of training?
    pub held_out: bool,
    /// Clouds for which no model came back.
    pub failed: usize,
    /// Median and greatest time for one cloud, s.
    pub seconds: [f64; 2],
    /// By category, the mean of these, by joint state.
    pub rows: Vec<PerceptionRow>,
    /// Objects of other makers, one row a model. They count in no other row.
    pub makers: Vec<PerceptionRow>,
}

fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

fn median(x: &[f64]) -> f64 {
    let mut x = x.to_vec();
    x.sort_by(f64::total_cmp);
    match x.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => x[n / 2],
        n => (x[n / 2 - 1] + x[n / 2]) / 2.0,
    }
}

/// Average precision (area under the precision that is still to come): masks by falling confidence, `right` where the overlap
/// suffices.
fn average_precision(mut masks: Vec<(f64, bool)>, truths: usize) -> f64 {
    if truths == 0 {
        return f64::NAN;
    }
    masks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut right = 0.0;
    let mut curve = Vec::with_capacity(masks.len());
    for (i, (_, ok)) in masks.iter().enumerate() {
        right += f64::from(u8::from(*ok));
        curve.push((right / truths as f64, right / (i as f64 + 1.0)));
    }
    let mut best = 0.0_f64;
    let mut area = 0.0;
    for k in (0..curve.len()).rev() {
        best = best.max(curve[k].1);
        area += best * (curve[k].0 - if k > 0 { curve[k - 1].0 } else { 0.0 });
    }
    area
}

fn row(name: &str, clouds: &[&Scored], keep: &dyn Fn(&PartScore) -> bool, whole_clouds: bool) -> PerceptionRow {
    let parts: Vec<(&PartScore, f64)> =
        clouds.iter().flat_map(|c| c.parts.iter().map(move |p| (p, c.diagonal))).filter(|(p, _)| keep(p)).collect();
    let body = |c: &&Scored| c.body_overlap.filter(|_| whole_clouds);
    let overlaps: Vec<f64> = clouds.iter().filter_map(body).chain(parts.iter().map(|(p, _)| p.overlap)).collect();
    let truths = overlaps.len();
    let precision = |least: f64, moving: bool| {
        if !whole_clouds {
            // Masks have no joint state: the share of parts that are found.
            return parts.iter().filter(|(p, _)| p.overlap >= least).count() as f64 / parts.len() as f64;
        }
        let masks = clouds.iter().flat_map(|c| &c.masks).filter(|m| m.moves || !moving);
        // A body that is taken for a part is no moving part that was found.
        let right = |m: &Mask| m.overlap >= least && (m.takes_moving || !moving);
        average_precision(masks.map(|m| (m.confidence, right(m))).collect(), if moving { parts.len() } else { truths })
    };
    let types: Vec<f64> = parts.iter().filter_map(|(p, _)| p.type_right).map(|t| f64::from(u8::from(t))).collect();
    let axes: Vec<f64> = parts.iter().filter_map(|(p, _)| p.axis).map(f64::to_degrees).collect();
    let lines: Vec<f64> = parts.iter().filter_map(|(p, _)| p.place).map(|x| 100.0 * x[0]).collect();
    let places: Vec<f64> = parts.iter().filter_map(|(p, _)| p.place).map(|x| 100.0 * x[1]).collect();
    let shares: Vec<f64> = parts.iter().filter_map(|(p, d)| p.place.map(|x| 100.0 * x[1] / d)).collect();
    PerceptionRow {
        name: name.to_owned(),
        clouds: clouds.len(),
        parts: parts.len(),
        miou: mean(&overlaps),
        ap50: precision(0.5, false),
        ap75: precision(0.75, false),
        map: (0..10).map(|k| precision(0.5 + 0.05 * f64::from(k), false)).sum::<f64>() / 10.0,
        ap75_moving: precision(0.75, true),
        type_accuracy: mean(&types),
        axis_mean: mean(&axes),
        axis_median: median(&axes),
        line_mean: mean(&lines),
        line_median: median(&lines),
        place_mean: mean(&places),
        place_median: median(&places),
        place_percent: mean(&shares),
        end_to_end: mean(&parts.iter().map(|(p, _)| f64::from(u8::from(p.whole))).collect::<Vec<_>>()),
        false_joints: clouds.iter().map(|c| c.false_joints as f64).sum::<f64>() / clouds.len() as f64,
        paper: PAPER.iter().find(|p| p.0 == name).map(|p| p.1),
    }
}

/// The mean of the categories' rows.
fn overall(rows: &[PerceptionRow]) -> PerceptionRow {
    let over = |f: &dyn Fn(&PerceptionRow) -> f64| mean(&rows.iter().map(f).filter(|x| x.is_finite()).collect::<Vec<_>>());
    PerceptionRow {
        name: "overall".to_owned(),
        clouds: rows.iter().map(|r| r.clouds).sum(),
        parts: rows.iter().map(|r| r.parts).sum(),
        miou: over(&|r| r.miou),
        ap50: over(&|r| r.ap50),
        ap75: over(&|r| r.ap75),
        map: over(&|r| r.map),
        ap75_moving: over(&|r| r.ap75_moving),
        type_accuracy: over(&|r| r.type_accuracy),
        axis_mean: over(&|r| r.axis_mean),
        axis_median: over(&|r| r.axis_median),
        line_mean: over(&|r| r.line_mean),
        line_median: over(&|r| r.line_median),
        place_mean: over(&|r| r.place_mean),
        place_median: over(&|r| r.place_median),
        place_percent: over(&|r| r.place_percent),
        end_to_end: over(&|r| r.end_to_end),
        false_joints: over(&|r| r.false_joints),
        paper: PAPER.iter().find(|p| p.0 == "overall").map(|p| p.1),
    }
}

pub(crate) fn table(options: &PerceptionOptions, scored: &[Scored], makers: &[(String, Vec<Scored>)]) -> PerceptionTable {
    let mut rows = Vec::new();
    for category in Category::ALL {
        let of: Vec<&Scored> = scored.iter().filter(|s| s.category == category).collect();
        if !of.is_empty() {
            rows.push(row(category.name(), &of, &|_| true, true));
        }
    }
    if rows.len() > 1 {
        rows.push(overall(&rows));
    }
    let all: Vec<&Scored> = scored.iter().collect();
    for (name, opening) in [("shut", Opening::Shut), ("ajar", Opening::Ajar), ("open", Opening::Open)] {
        rows.push(row(name, &all, &|p| p.opening == opening, false));
    }
    let made = |(name, scored): &(String, Vec<Scored>)| {
        // The paper measured other objects under these names.
        PerceptionRow { paper: None, ..row(name, &scored.iter().collect::<Vec<_>>(), &|_| true, true) }
    };
    let makers = makers.iter().map(made).collect();
    let times: Vec<f64> = scored.iter().map(|s| s.seconds).collect();
    PerceptionTable {
        schema: 1,
        seed: options.seed,
        held_out: !options.trained,
        failed: scored.iter().filter(|s| s.failed).count(),
        seconds: [median(&times), times.iter().copied().fold(0.0, f64::max)],
        rows,
        makers,
    }
}

fn number(x: f64, width: usize, digits: usize) -> String {
    match x.is_finite() {
        true => format!("{x:width$.digits$}"),
        false => format!("{:>width$}", "-"),
    }
}

fn line(text: &mut String, r: &PerceptionRow) {
    let _ = writeln!(
        text,
        "{:14} {:7} {:5} {} {} {} {} {} {} {} ({}) {} ({}) {} ({}) {} {} {}",
        r.name,
        r.clouds,
        r.parts,
        number(r.miou, 6, 3),
        number(r.ap50, 6, 3),
        number(r.ap75, 6, 3),
        number(r.map, 6, 3),
        number(r.ap75_moving, 7, 3),
        number(r.type_accuracy, 6, 3),
        number(r.axis_mean, 8, 2),
        number(r.axis_median, 4, 2),
        number(r.line_mean, 7, 2),
        number(r.line_median, 4, 2),
        number(r.place_mean, 8, 2),
        number(r.place_median, 4, 2),
        number(r.place_percent, 6, 2),
        number(r.end_to_end, 6, 3),
        number(r.false_joints, 6, 2),
    );
    if let Some([ap75, kind, axis, place]) = r.paper {
        let _ = writeln!(
            text,
            "  paper, init                             {} {:>14} {} {} {:>33}",
            number(ap75, 6, 3),
            "",
            number(kind, 6, 3),
            number(axis, 8, 2),
            number(place, 8, 2)
        );
    }
}

impl PerceptionTable {
    /// The table for a person.
    pub fn to_text(&self) -> String {
        let mut text = String::from(
            "                clouds parts   mIoU   AP50   AP75    mAP AP75mov   type  axis deg (med)  line cm (med)  place cm (med)  % diag  whole  false\n",
        );
        self.rows.iter().for_each(|r| line(&mut text, r));
        if !self.makers.is_empty() {
            text += "objects of other makers, none of them trained on:\n";
            self.makers.iter().for_each(|r| line(&mut text, r));
        }
        let _ = writeln!(
            text,
            "{} families, seed {}; no model for {} clouds; {:.2} s a cloud (most {:.2})",
            if self.held_out { "held-out" } else { "trained" },
            self.seed,
            self.failed,
            self.seconds[0],
            self.seconds[1]
        );
        text
    }
}
