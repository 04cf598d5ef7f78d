//! One self-contained HTML page a scene: pictures, false-colour error, error table.

use super::statistics::Summary;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write;

/// A picture of the page.
pub struct Figure {
    /// Caption, plain text.
    pub caption: String,
    /// PNG file.
    pub png: Vec<u8>,
}

/// The page: everything inline, opens anywhere.
pub fn page(summary: &Summary, figures: &[Figure]) -> String {
    let mut html = String::new();
    let _ = write!(
        html,
        "<!doctype html><html lang=en><meta charset=utf-8>\
         <meta name=viewport content='width=device-width'>\
         <title>{0}: baked against reference</title><style>{STYLE}</style>\
         <h1>{0}: baked indirect light against the path-traced reference</h1>\
         <p class=lead>Relative RMS error of indirect irradiance (area-weighted, over the \
         reference's mean, the reference's own variance removed): \
         <b>median pose {1:.2} %</b>, worst pose {2:.2} %, median within .1 to .3 m of a surface \
         {3:.2} %. {4} poses, {5} points a pose, {6} reference paths a point.</p>",
        escape(&summary.scene),
        summary.median * 100.0,
        summary.worst * 100.0,
        summary.median_near * 100.0,
        summary.effort[0],
        summary.effort[1],
        summary.effort[2],
    );
    html.push_str("<div class=figures>");
    for figure in figures {
        let _ = write!(
            html,
            "<figure><img alt='{0}' src='data:image/png;base64,{1}'><figcaption>{0}</figcaption>\
             </figure>",
            escape(&figure.caption),
            STANDARD.encode(&figure.png)
        );
    }
    html.push_str("</div>");
    html.push_str(&plot(summary));
    html.push_str(
        "<table><tr><th>pose<th>lamp (m)<th>near a surface<th>mean E (W/m² for 1 W/sr)\
         <th>relative RMS<th>95 % interval<th>bias<th>reference noise",
    );
    for (i, pose) in summary.poses.iter().enumerate() {
        let [x, y, z] = pose.lamp;
        let noise = if pose.relative_rms < 2.0 * pose.reference_noise {
            " (at reference noise)"
        } else {
            ""
        };
        let _ = write!(
            html,
            "<tr><td>{i}<td>{x:.2} {y:.2} {z:.2}<td>{}<td>{:.4}<td>{:.2} %{noise}<td>± {:.2} %\
             <td>{:+.2} %<td>{:.2} %",
            if pose.near_surface { "yes" } else { "" },
            pose.mean_irradiance,
            pose.relative_rms * 100.0,
            pose.interval * 100.0,
            pose.relative_bias * 100.0,
            pose.reference_noise * 100.0,
        );
    }
    html.push_str("</table></html>\n");
    html
}

/// Relative RMS of all poses, sorted, as an SVG bar chart with intervals.
fn plot(summary: &Summary) -> String {
    let mut poses: Vec<_> = summary.poses.iter().collect();
    poses.sort_by(|a, b| a.relative_rms.total_cmp(&b.relative_rms));
    let (width, height) = (760.0, 180.0);
    let top = poses
        .iter()
        .map(|p| p.relative_rms + p.interval)
        .fold(0.01, f64::max);
    let step = width / poses.len().max(1) as f64;
    let y = |v: f64| height - v.max(0.0) / top * height;
    let mut svg = format!(
        "<svg viewBox='-50 -10 {} {}' role=img aria-label='relative RMS of every pose, sorted'>",
        width + 60.0,
        height + 40.0
    );
    for (i, pose) in poses.iter().enumerate() {
        let x = (i as f64 + 0.5) * step;
        let colour = if pose.near_surface {
            "#c8553d"
        } else {
            "#3d6fc8"
        };
        let _ = write!(
            svg,
            "<rect x='{:.1}' y='{:.1}' width='{:.1}' height='{:.1}' fill='{colour}'/>\
             <line x1='{x:.1}' x2='{x:.1}' y1='{:.1}' y2='{:.1}' stroke='#333'/>",
            x - step * 0.4,
            y(pose.relative_rms),
            step * 0.8,
            height - y(pose.relative_rms),
            y(pose.relative_rms + pose.interval),
            y(pose.relative_rms - pose.interval),
        );
    }
    for k in 0..=4 {
        let value = top * f64::from(k) / 4.0;
        let _ = write!(
            svg,
            "<text x='-6' y='{:.1}' text-anchor=end>{:.1} %</text>",
            y(value) + 4.0,
            value * 100.0
        );
    }
    let _ = write!(
        svg,
        "<text x='0' y='{}'>poses by error; red: .1 to .3 m from a surface</text></svg>",
        height + 22.0
    );
    svg
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('\'', "&#39;")
}

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:1100px;\
padding:0 1em;color:#222}h1{font-size:1.4em}.figures{display:grid;gap:1em;\
grid-template-columns:repeat(auto-fit,minmax(320px,1fr))}figure{margin:0}img{width:100%;\
image-rendering:auto;border:1px solid #ccc}figcaption{font-size:.9em;color:#555}\
table{border-collapse:collapse;margin-top:1.5em;font-variant-numeric:tabular-nums}\
td,th{padding:.2em .7em;text-align:right;border-bottom:1px solid #ddd}svg{margin-top:1.5em;\
max-width:820px;font:11px system-ui}";
