//! The parts of the page that are words and small tables.

use super::escape::escape;
use super::section;
use crate::record::names::{Division, Status};
use crate::record::result::{Cell, ResultFile};
use crate::report::numbers::{scientific, significant};
use crate::report::ranking::{Ranking, rankings};
use crate::report::view::View;
use crate::report::wording::{self, Tone};
use crate::statistics::ranking::{PENALTY, profile};
use std::fmt::Write;

/// What a newcomer should take away.
pub fn verdict(name: &str, view: &View<'_>) -> String {
    let item = |s: &wording::Statement| {
        let class = match s.tone {
            Tone::Plain => "plain",
            Tone::Warning => "warning",
            Tone::Bad => "bad",
        };
        format!("<li class=\"{class}\">{}</li>", escape(&s.text))
    };
    let statements = wording::verdict(view);
    let (first, rest) = statements.split_at(statements.len().min(8));
    let list = |part: &[wording::Statement]| part.iter().map(item).collect::<String>();
    let mut html = format!(
        "<section class=\"verdict\"><h2>Verdict</h2><p class=\"file\">{}</p><ul>{}</ul>",
        escape(name),
        list(first)
    );
    if !rest.is_empty() {
        let _ =
            write!(html, "<details><summary>{} more</summary><ul>{}</ul></details>", rest.len(), list(rest));
    }
    html + "</section>\n"
}

/// Ranks that are shown at once; further ones are folded away.
const RANKS_SHOWN: usize = 4;

/// Ranks over several problems with performance profiles.
pub fn ranks(view: &View<'_>) -> String {
    let tables: Vec<String> = rankings(view).iter().map(rank_table).collect();
    let (first, rest) = tables.split_at(tables.len().min(RANKS_SHOWN));
    let mut tables = first.concat();
    if !rest.is_empty() {
        let _ = write!(tables, "<details><summary>{} more</summary>{}</details>", rest.len(), rest.concat());
    }
    let lead = format!(
        "Only right answers to one workload compete, within one precision, one kind of hardware, one number of threads and one level of \
         achieved error. The figures are geometric means of the time over that of the fastest on each problem: 1 is the \
         fastest everywhere. <em>Common</em> uses the problems that every solver has; <em>all</em> counts a missing answer as {PENALTY} \
         times the slowest. = marks ties: intervals of the medians that overlap, or less than 3% apart. <em>Within 2&times;</em> is \
         the share of problems solved in at most twice the time of the fastest. <em>Tuned</em> rows have settings chosen \
         for this work, <em>default</em> rows those of the library."
    );
    section("Ranking", &lead, &tables)
}

fn rank_table(ranking: &Ranking) -> String {
    let mut rows = String::new();
    for s in &ranking.standings {
        let (name, division) = &ranking.solvers[s.solver];
        let _ = write!(
            rows,
            "<tr><td>{}{}</td><th scope=\"row\">{}</th><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{} of {}</td>",
            s.rank,
            if s.tied { "=" } else { "" },
            escape(name),
            division_name(*division),
            s.intersection.map_or_else(String::new, significant),
            significant(s.penalised),
            s.solved,
            ranking.problems.len(),
        );
        for factor in [1.0, 2.0, 5.0] {
            let _ = write!(
                rows,
                "<td class=\"n\">{:.0}%</td>",
                100.0 * profile(&ranking.times, s.solver, factor)
            );
        }
        rows += "</tr>";
    }
    format!(
        "<h3>{}</h3><p class=\"lead\">{}</p><div class=\"scroll\"><table><thead><tr><th>rank</th><th>solver</th><th>settings</th><th>common</th><th>all</th>\
         <th>problems</th><th>fastest</th><th>within 2&times;</th><th>within 5&times;</th></tr></thead><tbody>{rows}</tbody></table></div>",
        escape(&ranking.class.title()),
        escape(&format!("Problems: {}.", ranking.problems.join("; "))),
    )
}

/// "tuned", "default", or nothing where it is not known.
pub fn division_name(division: Option<Division>) -> &'static str {
    match division {
        Some(Division::Open) => "tuned",
        Some(Division::Closed) => "default",
        None => "",
    }
}

/// Solvers down, problems across: how every cell ended, and how good its answers are.
pub fn validation(view: &View<'_>) -> String {
    let mut head = String::from("<th>solver</th>");
    for group in &view.groups {
        let _ = write!(head, "<th>{}</th>", escape(&group.title()));
    }
    let mut rows = String::new();
    for solver in &view.solvers {
        let _ = write!(rows, "<tr><th scope=\"row\">{}</th>", escape(solver));
        for group in &view.groups {
            let cell = group.cells.iter().find(|cell| view.label(cell) == *solver);
            rows += &cell.map_or_else(|| "<td></td>".to_owned(), |cell| verdict_cell(cell));
        }
        rows += "</tr>";
    }
    let table = format!(
        "<div class=\"scroll\"><table class=\"matrix\"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
    );
    let lead = "Every answer was checked outside of the timed region. Shown: backward error (how much the equations would have to \
                change for the answer to be exact), then forward error against a refined solution; a wrong answer has no time.";
    if view.groups.is_empty() { String::new() } else { section("Validation", lead, &table) }
}

fn verdict_cell(cell: &Cell) -> String {
    let class = match cell.status {
        Status::Ok => "ok",
        Status::Invalid => "invalid",
        Status::Unavailable | Status::Unsupported => "absent",
        _ => "failed",
    };
    let number = |x: Option<f64>| x.map_or_else(|| "\u{2013}".to_owned(), scientific);
    let words = match cell.status {
        Status::Ok if cell.accuracy.certifiable == Some(false) => {
            format!("{} / not certifiable", number(cell.accuracy.backward_error))
        }
        Status::Ok => {
            format!("{} / {}", number(cell.accuracy.backward_error), number(cell.accuracy.forward_error))
        }
        status => status.name().replace('_', " "),
    };
    let reason = cell.reason.as_deref().unwrap_or_default();
    format!("<td class=\"{class}\" title=\"{}\">{words}</td>", escape(reason))
}

/// The machine and the build.
pub fn environment(result: &ResultFile) -> String {
    let value = serde_json::to_value(&result.environment).unwrap_or_default();
    let mut rows = String::new();
    for part in ["fingerprint", "info"] {
        for (name, value) in value[part].as_object().into_iter().flatten() {
            let text = match value {
                serde_json::Value::Null => "unknown".to_owned(),
                serde_json::Value::String(text) => text.clone(),
                serde_json::Value::Array(items) => {
                    items.iter().filter_map(|item| item.as_str()).collect::<Vec<_>>().join(" ")
                }
                other => other.to_string(),
            };
            let _ = write!(
                rows,
                "<tr><th scope=\"row\">{}</th><td>{}</td></tr>",
                escape(&name.replace('_', " ")),
                escape(&text)
            );
        }
    }
    let solvers = solver_details(result);
    let table = format!("<div class=\"scroll\"><table>{rows}</table></div>{solvers}");
    section("Environment", "Times of different machines or builds do not compare.", &table)
}

/// What every solver says about itself, once.
fn solver_details(result: &ResultFile) -> String {
    let mut seen: Vec<&str> = Vec::new();
    let mut rows = String::new();
    for cell in &result.cells {
        if seen.contains(&cell.backend.as_str()) || cell.details.is_empty() {
            continue;
        }
        seen.push(&cell.backend);
        let details: Vec<String> =
            cell.details.iter().map(|(name, value)| format!("{name}: {value}")).collect();
        let threads =
            cell.threads_used.map_or_else(String::new, |n| format!("; uses {n} of {} threads", cell.threads));
        let device = cell.device.as_deref().unwrap_or_default();
        let _ = write!(
            rows,
            "<tr><th scope=\"row\">{}</th><td>{}</td></tr>",
            escape(&cell.backend),
            escape(&format!("{device}{threads}; {}", details.join("; ")))
        );
    }
    if rows.is_empty() {
        return rows;
    }
    format!(
        "<details><summary>What the solvers say about themselves</summary><div class=\"scroll\"><table>{rows}</table></div></details>"
    )
}

/// How to get these figures again.
pub fn reproduce(result: &ResultFile) -> String {
    let commit = result
        .environment
        .info
        .commit
        .as_deref()
        .map_or_else(String::new, |c| format!("git checkout {}\n", c.trim_end_matches("-dirty")));
    let command = format!("<pre>{}{}</pre>", escape(&commit), escape(&result.command));
    section("Reproduce", "The command that made this result, and the commit of the program.", &command)
}
