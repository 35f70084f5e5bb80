//! `report.html`: the answer for a person, one page that needs nothing else, neither a network nor a script.
//!
//! It says first what is missing, then how much that explains, then where and why, and at the end what was done, step by step. All figures
//! are those of `gap.json`; only the plots ([`PlotData`]) are not in it.

use std::fmt::Write;

use sagci_dynamics::effects;

use crate::Found;
use crate::chart::{Chart, escape, number, wider};
use crate::plots::{JointPlot, PlotData, WindowPlot};
use crate::report::{Experiment, Gap, NamedEffect, Report, Verdict};

/// Writing to a text cannot fail.
macro_rules! put {
    ($out:expr, $($text:tt)*) => {{
        let _ = write!($out, $($text)*);
    }};
}

/// The page. `name` is the model's.
pub fn page(name: &str, found: &Found) -> String {
    let (report, figures) = (&found.report, &found.figures);
    let mut out = String::new();
    let title = escape(name);
    put!(
        out,
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>{title}: the gap between simulation and measurement</title><style>{}</style></head><body><main>\n",
        include_str!("page.css")
    );
    put!(out, "<div class=\"kicker\">Gap between simulation and measurement</div><h1>{title}</h1>\n");
    put!(out, "<p class=\"verdict\">{}</p>\n", verdict(report));
    effects_found(&mut out, report);
    gaps(&mut out, report, figures);
    places(&mut out, report, figures);
    motion(&mut out, figures);
    forces(&mut out, report, figures);
    left(&mut out, report);
    steps(&mut out, report, figures);
    notes(&mut out, report, figures);
    out.push_str("</main></body></html>\n");
    out
}

/// The answer in a sentence or two.
fn verdict(report: &Report) -> String {
    let named: Vec<String> = report
        .effects
        .iter()
        .map(|e| {
            let or: String = e.alternatives.iter().map(|a| format!(" or {}", term(a))).collect();
            format!("<strong>{}</strong>{or} on {}", term(&e.name), on(e))
        })
        .collect();
    let list = match named.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} and {last}", rest.join(", ")),
        _ => named.concat(),
    };
    let mut text = match report.verdict {
        Verdict::NoGap => "Nothing is missing that these data could show.".into(),
        Verdict::Named => format!("The model lacks {list}."),
        Verdict::Ambiguous => format!("The model lacks {list}; the data cannot tell some names apart."),
        Verdict::Unknown if named.is_empty() => "Something is missing that no name of the catalogue fits.".into(),
        Verdict::Unknown => format!("The model lacks {list}, and something besides that no name of the catalogue fits."),
    };
    let (gap, data) = report.gap.held_out.as_ref().map_or((&report.gap.train, "the data of the fit"), |g| (g, "data that no fit has seen"));
    if !report.effects.is_empty() {
        put!(
            text,
            " On {data} the error of predictions goes from {} ({} once its known numbers are refitted) to {} of the joints' range{}; noise alone \
             makes {}.",
            percent(gap.before),
            percent(gap.refitted),
            percent(gap.after),
            factor(gap.refitted, gap.after),
            percent(gap.noise_floor)
        );
    } else {
        put!(
            text,
            " On {data} predictions are off by {} of the joints' range; noise alone makes {}.",
            percent(gap.refitted),
            percent(gap.noise_floor)
        );
    }
    text
}

fn factor(before: f64, after: f64) -> String {
    let times = before / after;
    if times.is_finite() && times > 1.05 { format!(" ({times:.1} times less than refitted)") } else { String::new() }
}

fn term(name: &str) -> String {
    escape(&name.replace('_', " "))
}

fn on(effect: &NamedEffect) -> String {
    let place = escape(effect.place());
    if effect.joint.is_some() { format!("<span class=\"name\">{place}</span>") } else { place }
}

fn percent(share: f64) -> String {
    format!("{} %", number((share * 1e4).round() / 100.0))
}

fn effects_found(out: &mut String, report: &Report) {
    if report.effects.is_empty() {
        return;
    }
    out.push_str("<h2>What is missing</h2>\n");
    for effect in &report.effects {
        let (class, badge) = match (effect.confirmed, effect.evidence.held_out) {
            (true, _) => ("good", "confirmed by held-out data"),
            (false, None) => ("doubt", "not confirmed: nothing was held out"),
            (false, Some(_)) => ("doubt", "not confirmed by held-out data"),
        };
        put!(
            out,
            "<section class=\"card\"><h3><span class=\"name\">{}</span> on {}<span class=\"badge {class}\">{badge}</span></h3>",
            escape(&effect.name),
            on(effect)
        );
        if let Ok(found) = effects::find(&effect.name) {
            let description = found.description();
            put!(out, "<p>{}.</p>", capital(description.summary));
            put!(
                out,
                "<p class=\"faint\"><small>It shows as: {}. Source: {}.</small></p>",
                escape(description.signature),
                escape(description.source.trim_end_matches('.'))
            );
        }
        if !effect.alternatives.is_empty() {
            let names: Vec<String> = effect.alternatives.iter().map(|n| format!("<code>{}</code>", escape(n))).collect();
            put!(out, "<p class=\"doubt\">As far as these data can tell it may as well be {}.</p>", names.join(" or "));
        }
        out.push_str(
            "<div class=\"wide\"><table><tr><th>parameter</th><th class=\"n\">value</th><th>interval of 95 %</th><th>unit</th></tr>",
        );
        for (name, v) in &effect.parameters {
            put!(
                out,
                "<tr><td class=\"name\">{}</td><td class=\"n\">{}</td><td>{} to {}</td><td>{}</td></tr>",
                escape(name),
                number(v.value),
                number(v.lower),
                number(v.upper),
                escape(if v.unit == "1" { "" } else { &v.unit })
            );
        }
        for (name, word) in &effect.choices {
            put!(out, "<tr><td class=\"name\">{}</td><td colspan=\"3\">{}</td></tr>", escape(name), escape(word));
        }
        out.push_str("</table></div>");
        let e = &effect.evidence;
        put!(
            out,
            "<p>Probability {} among all names that were tried, &ldquo;none of these&rdquo; included. Evidence: e<sup>{}</sup> against the model \
             without it, e<sup>{}</sup> against a force without a name.",
            probability(effect.probability),
            number(round(e.log_bayes_factor)),
            number(round(e.log_bayes_factor_nameless))
        );
        if let Some(fall) = e.held_out {
            put!(out, " On held-out data the log-likelihood of the measured positions rises by {}.", number(round(fall)));
        }
        out.push_str("</p>");
        if !effect.runners_up.is_empty() {
            out.push_str("<h3>What came next, and why it lost</h3><div class=\"wide\"><table>");
            for r in &effect.runners_up {
                put!(out, "<tr><td><code>{}</code></td><td>{}</td></tr>", escape(&r.name), escape(&r.reason));
            }
            out.push_str("</table></div>");
        }
        out.push_str("</section>\n");
    }
}

fn round(x: f64) -> f64 {
    (x * 10.0).round() / 10.0
}

fn capital(text: &str) -> String {
    let mut chars = text.chars();
    escape(&chars.next().map_or_else(String::new, |c| c.to_uppercase().collect::<String>() + chars.as_str()))
}

fn probability(p: f64) -> String {
    match p {
        p if p > 0.9995 => "above 99.9 %".into(),
        p if p < 0.0005 => "below 0.1 %".into(),
        p => percent(p),
    }
}

fn gaps(out: &mut String, report: &Report, figures: &PlotData) {
    out.push_str("<h2>The gap</h2>\n");
    put!(
        out,
        "<p>How far positions are off that are predicted alone over windows of {} s, root mean square: by the model as given, with its known \
         numbers refitted, with the effects, and what noise alone leaves.</p>",
        number(figures.window)
    );
    let both = [("Held out: data that no fit has seen", report.gap.held_out.as_ref()), ("Data of the fit", Some(&report.gap.train))];
    out.push_str("<div class=\"two\">");
    for (title, gap) in both {
        let Some(gap) = gap else {
            put!(
                out,
                "<div><h3>Held out</h3><p class=\"doubt\">Nothing was held out, so nothing confirms the fit on other data.</p></div>"
            );
            continue;
        };
        put!(out, "<div><h3>{title}</h3>");
        bars(out, "all joints, share of their range", "", [gap.before, gap.refitted, gap.after, gap.noise_floor].map(|x| (x, percent(x))));
        for (joint, g) in &gap.per_joint {
            let numbers = [g.before, g.refitted, g.after, g.noise_floor].map(|x| (x, format!("{} {}", number(x), g.unit)));
            bars(out, &escape(joint), &format!("range {} {}", number(g.range), g.unit), numbers);
        }
        out.push_str("</div>");
    }
    out.push_str("</div>");
    out.push_str("<details><summary>Medians over windows, and windows of 0.25 s</summary>");
    for (title, gap) in both {
        if let Some(gap) = gap {
            medians(out, title, gap);
        }
    }
    out.push_str("</details>\n");
}

const STAGES: [(&str, &str); 4] = [("before", "k-before"), ("refitted", "k-refitted"), ("after", "k-after"), ("noise floor", "k-floor")];

fn bars(out: &mut String, title: &str, remark: &str, numbers: [(f64, String); 4]) {
    let most = numbers.iter().map(|n| n.0).filter(|x| x.is_finite()).fold(0.0, f64::max).max(1e-300);
    put!(out, "<p><strong>{title}</strong> <small>{remark}</small></p><div class=\"bars\">");
    for ((label, class), (value, text)) in STAGES.iter().zip(numbers) {
        let width = (100.0 * value / most).clamp(0.0, 100.0);
        put!(out, "<b>{label}</b><div class=\"track\"><i class=\"{class}\" style=\"width:{width:.1}%\"></i></div><span>{text}</span>");
    }
    out.push_str("</div>");
}

fn medians(out: &mut String, title: &str, gap: &Gap) {
    put!(out, "<h3>{title}</h3><div class=\"wide\"><table><tr><th>joint</th><th>figure</th>");
    for (label, _) in STAGES {
        put!(out, "<th class=\"n\">{label}</th>");
    }
    out.push_str("<th></th></tr>");
    for (joint, g) in &gap.per_joint {
        for (what, numbers) in [("median over windows", g.median), ("windows of 0.25 s", g.short)] {
            put!(out, "<tr><td class=\"name\">{}</td><td>{what}</td>", escape(joint));
            for x in numbers {
                put!(out, "<td class=\"n\">{}</td>", number(x));
            }
            put!(out, "<td>{}</td></tr>", g.unit);
        }
    }
    out.push_str("</table></div>");
}

fn places(out: &mut String, report: &Report, figures: &PlotData) {
    if report.places.is_empty() {
        return;
    }
    out.push_str(
        "<h2>Where</h2>\n<p>Where the model as given lacks force, its known numbers refitted: the part of positions, velocities and times that \
         holds the middle 80 % of the lacking force's squares, within all that was measured.</p>\n",
    );
    out.push_str("<div class=\"wide\"><table><tr><th>joint</th><th>position</th><th>velocity</th><th>time, s</th><th class=\"n\">share</th><th class=\"n\">by chance</th></tr>");
    for place in &report.places {
        let plot = figures.joints.iter().find(|j| j.joint == place.joint);
        let unit = plot.map_or("rad", |p| p.units[0]);
        let chance = match place.p_value {
            p if p < 1e-12 => "below 1e−12".to_owned(),
            p => number(p),
        };
        put!(out, "<tr><td class=\"name\">{}<br><small>{}</small></td>", escape(&place.joint), escape(&place.channel));
        let ranges = plot.map(|p| [p.position, p.velocity, p.time]);
        for (i, (region, unit)) in
            [(place.region.position, unit.to_owned()), (place.region.velocity, format!("{unit}/s")), (place.region.time, "s".into())]
                .into_iter()
                .enumerate()
        {
            let rail = ranges.map_or_else(String::new, |r| rail(r[i], region));
            put!(out, "<td>{rail}<small>{} to {} {unit}</small></td>", number(region[0]), number(region[1]));
        }
        put!(out, "<td class=\"n\">{:.0} %</td><td class=\"n\">{chance}</td></tr>", 100.0 * place.share);
    }
    out.push_str("</table></div>\n");
}

/// A range with a part of it.
fn rail([low, high]: [f64; 2], part: [f64; 2]) -> String {
    let at = |x: f64| if high > low { (200.0 * (x - low) / (high - low)).clamp(0.0, 200.0) } else { 0.0 };
    let (a, b) = (at(part[0]), at(part[1]));
    format!(
        "<svg viewBox=\"0 0 200 12\" style=\"min-width:150px\" aria-hidden=\"true\"><rect class=\"rail\" width=\"200\" height=\"12\" rx=\"3\"/>\
         <rect class=\"part\" x=\"{a:.1}\" width=\"{:.1}\" height=\"12\" rx=\"2\"/></svg>",
        (b - a).max(2.0)
    )
}

fn motion(out: &mut String, figures: &PlotData) {
    if figures.joints.iter().all(|j| j.windows.is_empty()) {
        return;
    }
    let data = if figures.held_out { "held-out data" } else { "the data of the fit" };
    put!(
        out,
        "<h2>Predicted and measured</h2>\n<p>Windows of {data}, ranked by the error of the model as given. Each starts from the measured state; \
         then the model goes on alone.</p>\
         <div class=\"legend\"><span><i style=\"color:var(--ink);opacity:.4\"></i>measured</span>\
         <span><i style=\"color:var(--before);border-top-style:dashed\"></i>predicted before</span>\
         <span><i style=\"color:var(--after)\"></i>predicted after</span></div>\n"
    );
    for joint in figures.joints.iter().filter(|j| !j.windows.is_empty()) {
        put!(out, "<h3 class=\"name\">{}</h3><div class=\"three\">", escape(&joint.joint));
        for window in &joint.windows {
            out.push_str(&window_plot(joint, window));
        }
        out.push_str("</div>\n");
    }
}

fn window_plot(joint: &JointPlot, window: &WindowPlot) -> String {
    let span = |values: &[f64]| {
        values.iter().filter(|x| x.is_finite()).fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(*x), b.max(*x)])
    };
    let measured = span(&window.measured);
    // What diverges leaves the picture; it must not flatten the rest.
    let reach = (0.6 * (measured[1] - measured[0])).max(10.0 * joint.noise);
    let mut shown = measured;
    for other in [span(&window.before), span(&window.after)] {
        if other[0] <= other[1] {
            shown = [shown[0].min(other[0].max(measured[0] - reach)), shown[1].max(other[1].min(measured[1] + reach))];
        }
    }
    let time = span(&window.time);
    let unit = joint.units[0];
    let labels = ["time, s".to_owned(), format!("position, {unit}")];
    let title = capital_plain(window.rank);
    let mut chart = Chart::new([350.0, 230.0], time, wider(shown, 0.06), &title, [&labels[0], &labels[1]]);
    chart.line("measured", &window.time, &window.measured);
    chart.line("before", &window.time, &window.before);
    chart.line("after", &window.time, &window.after);
    let source = window.source.rsplit('/').next().unwrap_or(&window.source);
    let error = |x: f64| if x.is_finite() { format!("{} {unit}", number(x)) } else { "diverged".into() };
    format!(
        "<figure>{}<figcaption>{}: off by {} before, {} after</figcaption></figure>",
        chart.finish(),
        escape(source),
        error(window.rmse[0]),
        error(window.rmse[1])
    )
}

fn capital_plain(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |c| c.to_uppercase().collect::<String>() + chars.as_str())
}

fn forces(out: &mut String, report: &Report, figures: &PlotData) {
    if figures.joints.iter().all(|j| j.lacking[0].is_empty()) {
        return;
    }
    out.push_str(
        "<h2>Lacking force</h2>\n<p>The force against the motion along the positive axis that the model would need besides, to follow the data \
         of the fit: medians over bins of position, by direction, with two standard deviations. With all effects found it lies about zero. The \
         shaded band is where most of it lay.</p>\
         <div class=\"legend\"><span style=\"color:var(--after)\">▶ position grows</span><span style=\"color:var(--before)\">◁ position falls</span></div>\n",
    );
    for joint in figures.joints.iter().filter(|j| !j.lacking[0].is_empty()) {
        let all = joint.lacking.iter().flatten().flat_map(|b| b.forward.into_iter().chain(b.backward)).flat_map(|[m, s]| [m - s, m + s]);
        let [low, high] = all.filter(|x| x.is_finite()).fold([0.0f64, 0.0f64], |[a, b], x| [a.min(x), b.max(x)]);
        let labels = [format!("position, {}", joint.units[0]), format!("force, {}", joint.units[1])];
        put!(out, "<h3 class=\"name\">{}</h3><div class=\"two\">", escape(&joint.joint));
        for (title, bins, before) in
            [("Before: known numbers refitted", &joint.lacking[0], true), ("After: with the effects", &joint.lacking[1], false)]
        {
            let range = wider(joint.position, 0.02);
            let mut chart = Chart::new([520.0, 270.0], range, wider([low, high], 0.08), title, [&labels[0], &labels[1]]);
            if let Some(place) = report.places.iter().find(|p| before && p.joint == joint.joint && p.p_value < 0.01) {
                chart.band("where", place.region.position);
            }
            for bin in bins {
                for (mean, forward) in [(bin.forward, true), (bin.backward, false)] {
                    if let Some(mean) = mean.filter(|m| m[0].is_finite()) {
                        chart.point(if forward { "forward" } else { "backward" }, bin.position, mean, forward);
                    }
                }
            }
            put!(out, "<figure>{}</figure>", chart.finish());
        }
        out.push_str("</div>\n");
    }
}

fn left(out: &mut String, report: &Report) {
    out.push_str("<h2>What is left, and what next</h2>\n");
    match &report.unexplained {
        Some(left) => put!(
            out,
            "<p class=\"doubt\">{:.0} % of the lacking force has no name. It lies on <span class=\"name\">{}</span>, depends on {}, and acts at \
             positions {} to {}, velocities {} to {}, times {} to {} s.</p>",
            100.0 * left.share,
            escape(&left.joint),
            escape(&left.over),
            number(left.region.position[0]),
            number(left.region.position[1]),
            number(left.region.velocity[0]),
            number(left.region.velocity[1]),
            number(left.region.time[0]),
            number(left.region.time[1])
        ),
        None => out.push_str("<p>Nothing is left that would count.</p>"),
    }
    match &report.next_experiment {
        Some(next) => experiment(out, next),
        None => {
            let open: Vec<&NamedEffect> = report.effects.iter().filter(|e| !e.alternatives.is_empty()).collect();
            for effect in open {
                let hint = effects::find(&effect.name).map_or("", |e| e.description().experiment);
                put!(out, "<p>What would tell <code>{}</code> from the others: {}.</p>", escape(&effect.name), escape(hint));
            }
        }
    }
    if !report.baselines.is_empty() {
        out.push_str("<h3>Other ways, on the same data</h3><p>Pooled gap, in shares of the joints' ranges.</p><table>");
        put!(
            out,
            "<tr><td>this report</td><td class=\"n\">{}</td></tr>",
            percent(report.gap.held_out.as_ref().unwrap_or(&report.gap.train).after)
        );
        for (name, value) in &report.baselines {
            put!(out, "<tr><td>{}</td><td class=\"n\">{}</td></tr>", term(name), percent(*value));
        }
        out.push_str("</table>");
    }
    if !report.rejected.is_empty() {
        out.push_str("<h3>Looked at and refused</h3><div class=\"wide\"><table>");
        for r in &report.rejected {
            put!(out, "<tr><td><code>{}</code></td><td>{}</td></tr>", escape(&r.name), escape(&r.reason));
        }
        out.push_str("</table></div>\n");
    }
}

fn experiment(out: &mut String, next: &Experiment) {
    put!(
        out,
        "<section class=\"card\"><h3>Next experiment: <span class=\"name\">{}</span> on <span class=\"name\">{}</span></h3><p>{}.</p>",
        escape(&next.name),
        escape(&next.joint),
        capital(&next.reason)
    );
    let names: Vec<String> = next.separates.iter().map(|n| format!("<code>{}</code>", escape(n))).collect();
    let purpose = match names.len() {
        0 => String::new(),
        1 => format!("It would confirm {}", names[0]),
        _ => format!("It tells apart {}", names.join(", ")),
    };
    match next.expected_log_bayes_factor {
        Some(expected) if !purpose.is_empty() => {
            put!(out, "<p>{purpose}; evidence of about e<sup>{}</sup> is expected.</p>", number(round(expected)));
        }
        _ if !purpose.is_empty() => put!(out, "<p>{purpose}.</p>"),
        _ => {}
    }
    let numbers: Vec<String> =
        next.reference.numbers.iter().map(|(n, x)| format!("{} = {}", escape(&n.replace('_', " ")), number(*x))).collect();
    if !numbers.is_empty() {
        put!(out, "<p class=\"faint\">{} (SI units)</p>", numbers.join(", "));
    }
    put!(out, "<p>Once it is recorded: <code>{}</code></p></section>", escape(&next.command));
}

fn steps(out: &mut String, report: &Report, figures: &PlotData) {
    out.push_str("<h2>What was done</h2>\n<ol class=\"steps\">\n");
    let held = figures.recordings.iter().filter(|r| r.held_out).count();
    let seconds: f64 = figures.recordings.iter().map(|r| r.seconds).sum();
    put!(
        out,
        "<li><strong>Align, and exhaust the known.</strong> {} recording(s), {} s in all, {held} of them held out. ",
        figures.recordings.len(),
        number((seconds * 10.0).round() / 10.0)
    );
    for joint in &figures.joints {
        put!(
            out,
            "<span class=\"name\">{}</span> is moved by {}; the noise of its position is {} {}. ",
            escape(&joint.joint),
            joint.drive,
            number(joint.noise),
            joint.units[0]
        );
    }
    let gap = report.gap.held_out.as_ref().unwrap_or(&report.gap.train);
    put!(out, "With the numbers that the model has refitted, the gap goes from {} to {}.", percent(gap.before), percent(gap.refitted));
    if figures.known.is_empty() {
        out.push_str(" No known number moved.");
    } else {
        out.push_str(
            "<details><summary>Known numbers, before and after</summary><div class=\"wide\"><table><tr><th>number</th><th class=\"n\">given</th>\
             <th class=\"n\">refitted alone</th><th class=\"n\">beside the effects</th><th>unit</th></tr>",
        );
        for k in &figures.known {
            put!(
                out,
                "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td></tr>",
                escape(&k.what),
                number(k.given),
                number(k.refitted),
                number(k.beside),
                k.unit
            );
        }
        out.push_str("</table></div></details>");
    }
    out.push_str("</li>\n<li><strong>Where.</strong> ");
    match report.places.first().filter(|p| p.share > 0.0) {
        Some(place) => put!(
            out,
            "Most of the lacking force ({:.0} %) is on <span class=\"name\">{}</span>, between {} and {}.",
            100.0 * place.share,
            escape(&place.joint),
            number(place.region.position[0]),
            number(place.region.position[1])
        ),
        None => out.push_str("No force is lacking that stands out from noise."),
    }
    put!(
        out,
        "</li>\n<li><strong>Which.</strong> {} names of the catalogue were tried on every joint, first by the linear response of the prediction \
         errors, then the best by exact fits in the simulator; a force without a name competed.",
        figures.tried
    );
    if !figures.not_observable.is_empty() {
        let names: Vec<String> = figures.not_observable.iter().map(|n| format!("<code>{}</code>", escape(n))).collect();
        put!(out, " Recordings of this kind cannot show {}.", names.join(", "));
    }
    match report.effects.len() {
        0 => out.push_str(" None was convincing."),
        1 => out.push_str(" One was convincing."),
        n => put!(out, " {n} were convincing, one after the other, and each again beside the others."),
    }
    out.push_str("</li>\n<li><strong>Add.</strong> ");
    if report.effects.is_empty() {
        out.push_str("Nothing was added to the model.");
    } else {
        out.push_str(
            "Each effect is an entry of <code>model.yaml</code>, with value, interval, evidence and the hashes of the recordings; viscous and \
             Coulomb friction stand in the URDF, too.",
        );
        if !report.model.is_empty() {
            put!(out, " The model is <code>{}</code>.", escape(&report.model));
        }
    }
    put!(
        out,
        "</li>\n<li><strong>Show.</strong> On {} the gap is {} before, {} refitted, {} after; noise alone makes {}.</li>\n",
        if report.gap.held_out.is_some() { "held-out data" } else { "the data of the fit" },
        percent(gap.before),
        percent(gap.refitted),
        percent(gap.after),
        percent(gap.noise_floor)
    );
    out.push_str("<li><strong>What next.</strong> ");
    out.push_str(match (&report.next_experiment, report.verdict) {
        (Some(_), _) => "An experiment is proposed above.",
        (None, Verdict::Ambiguous) => "Some names are left; what tells them apart is said above.",
        (None, Verdict::Unknown) => "No experiment is known that would name what is left.",
        (None, _) => "No names are left to be told apart.",
    });
    out.push_str("</li>\n<li><strong>The rest.</strong> ");
    match (&report.residual, &report.unexplained) {
        (Some(tried), _) if tried.kept => put!(
            out,
            "A learned force on what is left takes the held-out gap from {} to {}; it is kept in <code>residual.safetensors</code>.",
            percent(tried.gap[0]),
            percent(tried.gap[1])
        ),
        (Some(tried), _) if tried.gap[0] != tried.gap[1] => put!(
            out,
            "A learned force on what is left takes the held-out gap from {} to {}: less than a tenth, so it is not kept.",
            percent(tried.gap[0]),
            percent(tried.gap[1])
        ),
        (_, Some(_)) => out.push_str("What is left without a name is described above; it is not in the model."),
        _ => out.push_str("Nothing was left for a learned force."),
    }
    out.push_str("</li>\n</ol>\n");
}

fn notes(out: &mut String, report: &Report, figures: &PlotData) {
    if !report.notes.is_empty() {
        out.push_str("<h2>Notes</h2>\n<ul>");
        for note in &report.notes {
            put!(out, "<li>{}</li>", escape(note));
        }
        out.push_str("</ul>\n");
    }
    out.push_str("<h2>Recordings</h2>\n<div class=\"wide\"><table><tr><th>file</th><th>used to</th><th class=\"n\">rows</th><th class=\"n\">s</th><th>SHA-256</th></tr>");
    for r in &figures.recordings {
        put!(
            out,
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td><code title=\"{}\">{}</code></td></tr>",
            escape(r.source.rsplit('/').next().unwrap_or(&r.source)),
            if r.held_out { "check" } else { "fit" },
            r.rows,
            number(r.seconds),
            escape(&r.hash),
            escape(r.hash.get(..16).unwrap_or(&r.hash))
        );
    }
    out.push_str("</table></div>\n");
    if report.seconds > 0.0 {
        put!(out, "<p class=\"faint\"><small>It took {} s.</small></p>\n", number((report.seconds * 10.0).round() / 10.0));
    }
}
