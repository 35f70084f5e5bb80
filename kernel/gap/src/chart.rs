//! Small charts as SVG: axes with round numbers, lines, and points with their spread.
//!
//! Colours are classes of the page's style sheet, so that they follow its light and dark theme.

use std::fmt::Write;

/// A chart in the making. Sizes are in units of the view box, of which one is about a pixel.
#[derive(Debug)]
pub(crate) struct Chart {
    x: [f64; 2],
    y: [f64; 2],
    width: f64,
    height: f64,
    marks: String,
    title: String,
    labels: [String; 2],
}

const LEFT: f64 = 58.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 38.0;

impl Chart {
    /// `x` and `y` are the ranges that are shown; `title` and `labels` are plain text.
    pub fn new([width, height]: [f64; 2], x: [f64; 2], y: [f64; 2], title: &str, labels: [&str; 2]) -> Self {
        Self { x: open(x), y: open(y), width, height, marks: String::new(), title: escape(title), labels: labels.map(escape) }
    }

    fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let share = |v: f64, [low, high]: [f64; 2]| (v - low) / (high - low);
        [
            LEFT + share(x, self.x) * (self.width - LEFT - RIGHT),
            // What lies far outside is clipped; its coordinate stays small enough for any viewer.
            (self.height - BOTTOM - share(y, self.y) * (self.height - TOP - BOTTOM)).clamp(-1e4, 1e4),
        ]
    }

    /// A line, broken where a number is missing.
    pub fn line(&mut self, class: &str, x: &[f64], y: &[f64]) {
        let mut path = String::new();
        let mut down = false;
        for (x, y) in x.iter().zip(y) {
            if !y.is_finite() {
                down = false;
                continue;
            }
            let [px, py] = self.at(*x, *y);
            // Writing to a text cannot fail, here and below.
            let _ = write!(path, "{}{px:.1} {py:.1}", if down { "L" } else { "M" });
            down = true;
        }
        let _ = write!(self.marks, "<path class=\"line {class}\" d=\"{path}\"/>");
    }

    /// A point with a bar of two standard deviations to either side; a triangle that points where the motion goes.
    pub fn point(&mut self, class: &str, x: f64, [mean, deviation]: [f64; 2], forward: bool) {
        let [px, py] = self.at(x, mean);
        let [_, low] = self.at(x, mean - 2.0 * deviation);
        let [_, high] = self.at(x, mean + 2.0 * deviation);
        let way = if forward { 4.5 } else { -4.5 };
        let _ = write!(
            self.marks,
            "<path class=\"spread {class}\" d=\"M{px:.1} {low:.1}V{high:.1}\"/><path class=\"point {class}\" \
             d=\"M{:.1} {:.1}L{:.1} {py:.1}L{:.1} {:.1}Z\"/>",
            px - 0.6 * way,
            py - 4.0,
            px + way,
            px - 0.6 * way,
            py + 4.0
        );
    }

    /// A band of `x`.
    pub fn band(&mut self, class: &str, [low, high]: [f64; 2]) {
        let (a, b) = (self.at(low, self.y[1]), self.at(high, self.y[0]));
        let (width, height) = ((b[0] - a[0]).max(1.0), b[1] - a[1]);
        let _ = write!(
            self.marks,
            "<rect class=\"band {class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"/>",
            a[0], a[1]
        );
    }

    /// The SVG.
    pub fn finish(self) -> String {
        let (w, h) = (self.width, self.height);
        let (right, low) = (w - RIGHT, h - BOTTOM);
        let mut axes = String::new();
        for tick in ticks(self.x, 5) {
            let [x, _] = self.at(tick, self.y[0]);
            let _ = write!(
                axes,
                "<path class=\"grid\" d=\"M{x:.1} {TOP}V{low}\"/><text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                low + 14.0,
                number(tick)
            );
        }
        for tick in ticks(self.y, 5) {
            let [_, y] = self.at(self.x[0], tick);
            let class = if tick == 0.0 { "grid zero" } else { "grid" };
            let _ = write!(
                axes,
                "<path class=\"{class}\" d=\"M{LEFT} {y:.1}H{right}\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                LEFT - 6.0,
                y + 3.5,
                number(tick)
            );
        }
        // One definition of the clip in each SVG; names are local enough since all charts of a size share their frame.
        let clip = format!("clip{w:.0}x{h:.0}");
        format!(
            "<svg viewBox=\"0 0 {w} {h}\" role=\"img\" aria-label=\"{title}\"><clipPath id=\"{clip}\"><rect x=\"{LEFT}\" y=\"{TOP}\" \
             width=\"{:.1}\" height=\"{:.1}\"/></clipPath><text class=\"title\" x=\"{LEFT}\" y=\"15\">{title}</text>{axes}\
             <g clip-path=\"url(#{clip})\">{}</g><text class=\"label\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text class=\"label\" transform=\"translate(12 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text></svg>",
            right - LEFT,
            low - TOP,
            self.marks,
            (LEFT + right) / 2.0,
            h - 7.0,
            self.labels[0],
            (TOP + low) / 2.0,
            self.labels[1],
            title = self.title,
        )
    }
}

/// A range that is not empty.
fn open([low, high]: [f64; 2]) -> [f64; 2] {
    if !(low.is_finite() && high.is_finite()) {
        return [-1.0, 1.0];
    }
    if high > low { [low, high] } else { [low - 0.5, low + 0.5] }
}

/// A range with a margin.
pub(crate) fn wider([low, high]: [f64; 2], share: f64) -> [f64; 2] {
    let margin = share * (high - low);
    [low - margin, high + margin]
}

/// Round numbers in a range, at steps of 1, 2 or 5 times a power of ten.
fn ticks([low, high]: [f64; 2], most: usize) -> Vec<f64> {
    let rough = (high - low) / most as f64;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough * 0.999).unwrap_or(10.0 * power);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last.min(first + 20)).map(|k| k as f64 * step).collect()
}

/// Three or four significant digits; powers of ten where a number is very small or large.
pub(crate) fn number(x: f64) -> String {
    if !x.is_finite() {
        return if x.is_nan() {
            "unknown"
        } else if x > 0.0 {
            "∞"
        } else {
            "−∞"
        }
        .into();
    }
    let size = x.abs();
    let text = if size == 0.0 {
        "0".into()
    } else if !(1e-4..1e6).contains(&size) {
        let power = size.log10().floor();
        let lead = x / 10f64.powf(power);
        format!("{lead:.1}e{power}")
    } else {
        let digits = (3 - size.log10().floor() as i32).clamp(0, 7) as usize;
        let text = format!("{x:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    };
    text.replace('-', "−")
}

/// Text in HTML and SVG.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_keep_their_size() {
        let all = [(0.0, "0"), (1.0, "1"), (-0.01234567, "−0.01235"), (1234.56, "1235"), (2.5e-7, "2.5e−7"), (f64::NAN, "unknown")];
        for (x, text) in all {
            assert_eq!(number(x), text);
        }
    }

    #[test]
    fn ticks_lie_in_the_range_and_are_round() {
        assert_eq!(ticks([0.0, 10.0], 5), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        let few = ticks([-0.013, 0.021], 5);
        assert!(few.len() >= 3 && few.iter().all(|t| (-0.013..=0.021).contains(t)) && few.contains(&0.0), "{few:?}");
    }

    #[test]
    fn a_name_cannot_break_out_of_the_page() {
        let mut chart = Chart::new([300.0, 200.0], [0.0, 0.0], [f64::NAN, 1.0], "<script>\"", ["a&b", "'"]);
        chart.line("after", &[0.0, 1.0, 2.0], &[1.0, f64::NAN, 1e300]);
        let svg = chart.finish();
        assert!(!svg.contains("<script") && svg.contains("a&amp;b") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
