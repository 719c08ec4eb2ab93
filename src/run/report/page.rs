//! The page of a report: one file that needs no other, no network and no script.

use super::{
    figures::Figures,
    plot::{MAX_POINTS, Plot},
};
use crate::{control::printable, job::tradeoff::escaped};
use base64::{Engine, engine::general_purpose::STANDARD};

/// Colours of both appearances; the lines keep a contrast of 3 to 1 to either background.
const STYLE: &str = ":root{color-scheme:light dark;--ink:#1d2227;--faint:#5d6670;--grid:#dfe3e8;--paper:#fff;--box:#f4f6f8;--warn:#9a5b00}\
    @media(prefers-color-scheme:dark){:root{--ink:#e4e8ec;--faint:#9aa4ae;--grid:#333a42;--paper:#15181c;--box:#1d2228;--warn:#f0b35a}}\
    body{font:15px/1.5 system-ui,sans-serif;margin:0 auto;max-width:1080px;padding:1.5em;color:var(--ink);background:var(--paper)}\
    h1{margin:0}h2{margin:1.6em 0 .4em;font-size:1.15em}p{margin:.4em 0}.faint{color:var(--faint)}.warn{color:var(--warn)}\
    img{width:100%;max-width:600px;height:auto;border-radius:6px;display:block;margin:1em 0}\
    .plots{display:flex;flex-wrap:wrap;gap:8px 20px}svg{max-width:100%;height:auto}\
    text{font:12px system-ui,sans-serif;fill:var(--faint)}.title{font-size:14px;font-weight:600;fill:var(--ink)}\
    .axis{stroke:var(--faint);fill:none}.grid{stroke:var(--grid)}.below{text-anchor:middle}.left{text-anchor:end}\
    .line{fill:none;stroke-width:1.8;stroke-linecap:round;stroke-linejoin:round}\
    .c0{stroke:#2f7fd0}.c1{stroke:#d2641e}.c2{stroke:#2d9650}.c3{stroke:#b352b3}.c4{stroke:#a88400}.c5{stroke:#c94a5e}.c6{stroke:#1d929c}.c7{stroke:#7f7f86}\
    table{border-collapse:collapse}td,th{padding:.2em .9em .2em 0;text-align:left;vertical-align:top;border-bottom:1px solid var(--grid)}\
    pre{background:var(--box);padding:.8em 1em;overflow:auto;border-radius:6px;font-size:13px}summary{cursor:pointer}";

/// The text of the page.
pub(super) fn html(figures: &Figures) -> String {
    let title = escaped(&printable(&figures.title));
    let settings: Vec<_> = figures.settings.lines().map(printable).collect();
    let plots: Vec<String> = figures.plots.iter().filter_map(Plot::svg).collect();
    let list = |lines: &[String]| -> String {
        lines.iter().map(|line| format!("<li>{}</li>", escaped(&printable(line)))).collect()
    };
    let looped = match &figures.looped {
        Some(bytes) => format!(
            "<img alt=\"The shot as a loop\" src=\"data:image/webp;base64,{}\">",
            STANDARD.encode(bytes)
        ),
        None => "<p class=\"faint\">The loop is missing: <code>meniscus preview</code> makes it.</p>".into(),
    };
    let warnings = match figures.warnings.is_empty() {
        true => "<p>None.</p>".into(),
        false => format!("<ul class=\"warn\">{}</ul>", list(&figures.warnings)),
    };
    let row = |cells: &[String]| -> String {
        let cells: String =
            cells.iter().map(|cell| format!("<td>{}</td>", escaped(&printable(cell)))).collect();
        format!("<tr>{cells}</tr>")
    };
    let files: String = figures.files.iter().map(|cells| row(cells)).collect();
    let thinned = match figures.longest > MAX_POINTS {
        true => format!(
            "<p class=\"faint\">Lines have {MAX_POINTS} points at most, of {} frames.</p>",
            figures.longest
        ),
        false => String::new(),
    };
    let plots = match plots.is_empty() {
        true => "<p class=\"faint\">The log has no frames.</p>".into(),
        false => format!("<div class=\"plots\">{}</div>{thinned}", plots.concat()),
    };
    format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{title}</title><style>{STYLE}</style>\n<h1>{title}</h1><p class=\"faint\">{}</p>\n{looped}\n\
         <h2>Warnings</h2>{warnings}\n<h2>Over frames</h2>{plots}\n<h2>Summary</h2><ul>{}</ul>\n\
         <h2>Files</h2><table><tr><th>kind<th>format<th>files<th>pattern</tr>{files}</table>\n\
         <h2>Reproduce</h2><pre>{}</pre>\n<h2>Settings</h2><details><summary>preset.toml</summary><pre>{}</pre></details></html>\n",
        escaped(&printable(&figures.subtitle)),
        list(&figures.summary),
        escaped(&printable(&figures.command)),
        escaped(&settings.join("\n")),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::report::plot::Series;

    #[test]
    fn a_page_needs_nothing_else_and_texts_of_a_shot_are_no_markup() {
        let evil = || "</pre><script>alert(1)</script>\" onload=\"x & \u{1b}[31m".to_owned();
        let points = vec![(1, 0.5), (2, 0.7)];
        let figures = Figures {
            title: evil(),
            subtitle: evil(),
            looped: Some(b"RIFF....WEBP".to_vec()),
            warnings: vec![evil()],
            plots: vec![Plot {
                title: evil(),
                unit: "%".into(),
                series: vec![Series { name: evil(), points }],
            }],
            longest: 2,
            summary: vec![evil()],
            files: vec![vec![evil(), evil()]],
            command: evil(),
            settings: evil(),
        };
        let page = html(&figures);
        assert!(!page.contains("<script") && !page.contains("onload=\"x"), "{page}");
        assert!(!page.contains("http:") && !page.contains("https:") && !page.contains("//"), "{page}");
        assert!(page.contains("src=\"data:image/webp;base64,UklGRi4uLi5XRUJQ\""));
        assert_eq!(page.matches("&lt;script&gt;").count(), 13);
        let bare = Figures { looped: None, warnings: Vec::new(), plots: Vec::new(), ..figures };
        let page = html(&bare);
        assert!(
            page.contains("The loop is missing")
                && page.contains("<p>None.</p>")
                && page.contains("no frames")
        );
    }
}
