//! How a board looks on a terminal of any size.
//!
//! From top to bottom: who it is, positions as large as there is room, the latest verdict
//! and hit in a line each, what was lost beside the link and the board, then all of the
//! verdict and the hits before. What finds no room is left out from below.

use std::time::Duration;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Paragraph, Widget, Wrap};
use umi_protocol::access::AccessMode;
use umi_protocol::hello::VERSION;
use umi_protocol::line::HitReport;
use umi_protocol::message::ResetReason;

use super::digits::Size;
use super::view::{Correction, View};
use crate::show::text;
use umi_client::axes::NAMES;

const PLAIN: Style = Style::new();
const FAINT: Style = Style::new().add_modifier(Modifier::DIM);
const TITLE: Style = Style::new().add_modifier(Modifier::BOLD);
const GOOD: Style = TITLE.fg(Color::Green);
const BAD: Style = TITLE.fg(Color::Red);
const CAUTION: Style = PLAIN.fg(Color::Yellow);

/// Columns of a small panel.
const PANEL: u16 = 38;

/// Lines of head, feed, the latest verdict and hit, and what was lost.
const NEEDED: usize = 15;

/// Lines of what else is worth more than the largest digits: all of the verdict, and hits.
const WANTED: usize = 10;

/// Draws a board.
pub fn draw(view: &View, area: Rect, buffer: &mut Buffer) {
    draw_with(
        view,
        area,
        buffer,
        size(view, area),
        "   q ends this, ? explains it",
    );
}

/// A board as plain text for a file or a script.
#[must_use]
pub fn text(view: &View, width: u16) -> String {
    const MOST_LINES: u16 = 80;
    let area = Rect::new(0, 0, width.max(20), MOST_LINES);
    let mut buffer = Buffer::empty(area);
    draw_with(view, area, &mut buffer, Size::Text, "");
    let line = |y| {
        let cells = (0..area.width).filter_map(|x| buffer.cell((x, y)));
        let line: String = cells.map(|cell| cell.symbol()).collect();
        line.trim_end().to_owned() + "\n"
    };
    let lines: String = (0..area.height).map(line).collect();
    lines.trim_end().to_owned() + "\n"
}

fn draw_with(view: &View, area: Rect, buffer: &mut Buffer, size: Size, keys: &str) {
    let mut page = Page { area, buffer };
    page.put(head(view, keys));
    page.gap();
    page.put(positions(view, size));
    let mut verdict = verdict(view).into_iter();
    let mut hits = hits(view).into_iter();
    let latest = verdict.by_ref().take(1).chain(teaching(view));
    let latest = latest.chain(wrong_level(view));
    page.put(latest.chain(hits.by_ref().take(1)).collect());
    page.gap();
    page.beside([
        (losses(view), Vec::new()),
        (link(view), brief_link(view)),
        (board(view), brief_board(view)),
    ]);
    for (name, rest) in [
        ("verdict", verdict.collect()),
        ("hits before", hits.collect()),
    ] {
        page.section(name, rest);
    }
}

/// What is left of the area is below what was put there.
struct Page<'a> {
    area: Rect,
    buffer: &'a mut Buffer,
}

impl Page<'_> {
    fn put(&mut self, lines: Vec<Line<'_>>) {
        let height = u16::try_from(lines.len()).unwrap_or(u16::MAX);
        Paragraph::new(lines).render(self.area, self.buffer);
        self.skip(height);
    }

    fn gap(&mut self) {
        self.skip(1);
    }

    /// Lines under a title; nothing without lines.
    fn section(&mut self, name: &'static str, lines: Vec<Line<'_>>) {
        if !lines.is_empty() {
            self.put(vec![title(name)]);
            self.put(lines);
            self.gap();
        }
    }

    fn skip(&mut self, lines: u16) {
        let lines = lines.min(self.area.height);
        self.area.y += lines;
        self.area.height -= lines;
    }

    /// Panels beside each other, as many as there is room, the others below: as they are if
    /// all of them find room, else in brief.
    fn beside<const N: usize>(&mut self, panels: [(Vec<Line<'_>>, Vec<Line<'_>>); N]) {
        let columns = usize::from((self.area.width / PANEL).max(1));
        let highest = panels.iter().map(|(full, _)| full.len() + 1).max();
        let high = highest.unwrap_or(0) * N.div_ceil(columns);
        let are_full = high <= usize::from(self.area.height);
        let mut others = Vec::new();
        let mut first = Vec::new();
        for (number, (full, brief)) in panels.into_iter().enumerate() {
            if number < columns || are_full {
                first.push(full);
            } else {
                others.extend(brief);
            }
        }
        let mut panels = first.into_iter().peekable();
        while panels.peek().is_some() {
            let mut most = 0;
            let mut area = self.area;
            for lines in panels.by_ref().take(columns) {
                most = most.max(u16::try_from(lines.len()).unwrap_or(u16::MAX));
                if columns > 1 {
                    area.width = (PANEL - 2).min(area.width);
                }
                Paragraph::new(lines).render(area, self.buffer);
                area.x = (area.x + PANEL).min(self.area.right());
                area.width = self.area.right() - area.x;
            }
            self.skip(most);
            if others.is_empty() {
                self.gap();
            }
        }
        if !others.is_empty() {
            self.put(others);
            self.gap();
        }
    }
}

/// What the keys do and what the words mean, instead of a board.
pub fn help(area: Rect, buffer: &mut Buffer) {
    let rows = [
        ("q, Esc, Ctrl-C", "end"),
        ("?, h", "this page; any key goes back"),
        (
            "mm, counts",
            "mm where the job's witness section says how many counts that is",
        ),
        ("feed", "speed along the path of the first three axes"),
        ("latest verdict", "OK or NG of the newest setup, and why"),
        ("lost", "must be all 0: red is what is missing or not valid"),
        ("link", "the connection from this computer to the board"),
        ("board", "what the board says of itself"),
    ];
    let lines = rows.map(|(name, meaning)| {
        let name = Span::styled(format!("{name:<16}"), TITLE);
        Line::from(vec![name, Span::raw(meaning)])
    });
    let page = Paragraph::new(lines.to_vec()).wrap(Wrap { trim: false });
    page.render(area, buffer);
}

/// The link in a line.
fn brief_link(view: &View) -> Vec<Line<'static>> {
    let link = &view.link;
    let damaged = link.damaged + u64::from(view.status.link_damaged);
    let said = format!(
        "link   {:.1} ms, damaged {damaged}, lost {}",
        link.answer.as_secs_f64() * 1e3,
        link.events_lost
    );
    let style = if damaged + link.events_lost > 0 {
        BAD
    } else {
        PLAIN
    };
    vec![Line::styled(said, style)]
}

/// The board in two lines.
fn brief_board(view: &View) -> Vec<Line<'static>> {
    let status = &view.status;
    let ng = status.verdicts.saturating_sub(status.verdicts_ok);
    let (started, style) = started(status.reset);
    vec![
        Line::raw(format!(
            "board  job {}",
            status.job.as_deref().unwrap_or("none")
        )),
        Line::styled(
            format!(
                "       {} OK, {ng} NG, on {} by {started}",
                status.verdicts_ok,
                uptime(status.uptime_us)
            ),
            style,
        ),
    ]
}

/// Why the board started.
fn started(reset: ResetReason) -> (String, Style) {
    let said = text::reset(reset).trim_start_matches(" by ").trim();
    let said = if said.is_empty() { "unknown" } else { said };
    let style = match reset {
        ResetReason::Watchdog | ResetReason::Panic => BAD,
        ResetReason::BrownOut => CAUTION,
        _ => PLAIN,
    };
    (said.to_owned(), style)
}

/// A time to the tenth of a second.
fn uptime(us: u64) -> String {
    let mut said = text::clock(us);
    said.truncate(said.len().saturating_sub(5));
    said
}

/// Who it is and whether it is there.
fn head(view: &View, keys: &str) -> Vec<Line<'static>> {
    let identity = &view.identity;
    let who = format!(
        "board {} {}, firmware {}",
        identity.board, identity.serial, identity.firmware
    );
    let mut head = vec![Line::styled(who, TITLE)];
    head.push(match &view.link.gone {
        None => Line::from(vec![
            Span::styled("connected", GOOD),
            Span::styled(keys.to_owned(), FAINT),
        ]),
        Some((why, since)) => Line::styled(
            format!("GONE for {:.0} s: {why}", since.as_secs_f64()),
            BAD.add_modifier(Modifier::REVERSED),
        ),
    });
    head
}

/// Numbers of the axes, all of the same width, and their unit.
fn numbers(view: &View) -> Vec<(String, &'static str)> {
    let axes = view.positions.counts.iter().enumerate();
    let numbers: Vec<(String, &str)> = axes
        .map(|(axis, counts)| match view.scale.mm(axis, *counts) {
            Some(mm) => (format!("{mm:.4}"), "mm"),
            None => (counts.to_string(), "counts"),
        })
        .collect();
    let width = numbers
        .iter()
        .map(|(text, _)| text.len())
        .max()
        .unwrap_or(0);
    // So wide that they stand still for a while.
    let width = width.max(9);
    let padded = numbers.into_iter();
    padded
        .map(|(text, unit)| (format!("{text:>width$}"), unit))
        .collect()
}

/// The largest digits for which there is room.
fn size(view: &View, area: Rect) -> Size {
    let numbers = numbers(view);
    let fits = |size: &Size| {
        let widest = numbers.iter().map(|(text, _)| size.width(text)).max();
        let wide = widest.unwrap_or(0) + "X  ".len() + " counts".len();
        let high = match size {
            Size::Large => numbers.len() * (size.height() + 1) + NEEDED + WANTED,
            Size::Middle | Size::Text => numbers.len() * size.height() + NEEDED,
        };
        wide <= usize::from(area.width) && high <= usize::from(area.height)
    };
    [Size::Large, Size::Middle]
        .into_iter()
        .find(fits)
        .unwrap_or(Size::Text)
}

fn positions(view: &View, size: Size) -> Vec<Line<'static>> {
    let numbers = numbers(view);
    if numbers.is_empty() {
        return vec![Line::styled("this board has no axes", FAINT)];
    }
    // What is no more true is faint.
    let style = if view.link.gone.is_some() {
        FAINT
    } else {
        TITLE
    };
    let mut lines = Vec::new();
    for (axis, (text, unit)) in numbers.iter().enumerate() {
        let name = NAMES
            .get(axis)
            .map_or(String::new(), |name| name.to_uppercase());
        let illegal = view.positions.illegal.get(axis).is_some_and(|n| *n > 0);
        let rows = size.lines(text);
        let last = rows.len() - 1;
        for (row, digits) in rows.into_iter().enumerate() {
            let name = if row == last { name.as_str() } else { "" };
            let unit = if row == last { *unit } else { "" };
            lines.push(Line::from(vec![
                Span::styled(format!("{name:<3}"), TITLE),
                Span::styled(digits, if illegal { style.fg(Color::Red) } else { style }),
                Span::styled(format!(" {unit}"), FAINT),
            ]));
        }
        // Smaller ones have half a line below them.
        if size == Size::Large {
            lines.push(Line::default());
        }
    }
    let feed = view
        .feed_mm_per_min
        .map_or("feed unknown".to_owned(), |feed| {
            format!("feed {feed:.0} mm/min")
        });
    let known = view.scale.counts_per_mm(0).is_some();
    let origin = match (known, view.scale.has_origin()) {
        (false, _) => "the job does not say how many counts a millimetre has",
        (true, true) => "coordinates of the control",
        (true, false) => "from where the counters show 0",
    };
    let (origin, style) = if view.positions.are_valid() {
        (origin, FAINT)
    } else {
        ("positions NOT VALID: motion was lost", BAD)
    };
    lines.push(Line::from(vec![
        Span::styled(format!("{feed:<22}"), TITLE),
        Span::styled(origin, style),
    ]));
    lines
}

/// A name and a value.
fn row(name: &str, value: impl Into<String>, style: Style) -> Line<'static> {
    Line::from(vec![
        Span::raw(format!("{name:<20}")),
        Span::styled(value.into(), style),
    ])
}

fn title(text: &'static str) -> Line<'static> {
    Line::styled(text, FAINT.add_modifier(Modifier::UNDERLINED))
}

/// How wide the latest touch was on the probe's line, where the board has told both of its edges.
fn touch_width(view: &View) -> String {
    match view.skip.width_ms() {
        Some(ms) => format!("{ms:.3} ms wide"),
        None => "width not told".into(),
    }
}

/// What must be zero.
fn losses(view: &View) -> Vec<Line<'static>> {
    let status = &view.status;
    let illegal: u64 = view.positions.illegal.iter().map(|n| u64::from(*n)).sum();
    let counted = [
        ("illegal transitions", illegal),
        ("lost samples", view.positions.lost_samples.into()),
        ("missed latches", status.latches.missed.into()),
        ("triggers not told", status.latches.untold.into()),
        ("bytes lost", status.counters.bytes_lost),
        ("events not sent", status.events_dropped.into()),
        ("journal failures", status.journal_failures.into()),
    ];
    let rows = counted
        .into_iter()
        .map(|(name, n)| row(name, n.to_string(), if n > 0 { BAD } else { GOOD }));
    [title("lost")].into_iter().chain(rows).collect()
}

fn link(view: &View) -> Vec<Line<'static>> {
    let link = &view.link;
    let zero = |n: u64| if n > 0 { BAD } else { PLAIN };
    let slow = link.answer > Duration::from_millis(100);
    let answer = format!("{:.1} ms", link.answer.as_secs_f64() * 1e3);
    let there = u64::from(view.status.link_damaged);
    vec![
        title("link"),
        row("answers in", answer, if slow { CAUTION } else { PLAIN }),
        row(
            "damaged, from board",
            link.damaged.to_string(),
            zero(link.damaged),
        ),
        row("damaged, to board", there.to_string(), zero(there)),
        row(
            "events lost here",
            link.events_lost.to_string(),
            zero(link.events_lost),
        ),
        row(
            "connected again",
            link.reconnected.to_string(),
            if link.reconnected > 0 { CAUTION } else { PLAIN },
        ),
        row("protocol", VERSION.to_string(), PLAIN),
    ]
}

fn board(view: &View) -> Vec<Line<'static>> {
    let status = &view.status;
    let latches = &status.latches;
    let (started, started_style) = started(status.reset);
    let ng = status.verdicts.saturating_sub(status.verdicts_ok);
    vec![
        title("board"),
        row("job", status.job.as_deref().unwrap_or("none"), PLAIN),
        row("running for", uptime(status.uptime_us), PLAIN),
        row("started by", started, started_style),
        row(
            "setups",
            format!("{} OK, {ng} NG", status.verdicts_ok),
            PLAIN,
        ),
        row("probe latches", latches.skips.to_string(), PLAIN),
        row("latest touch", touch_width(view), PLAIN),
        row("index latches", latches.indices.to_string(), PLAIN),
        row(
            "triggers",
            format!("{} in, {} out", latches.triggers, latches.outputs),
            PLAIN,
        ),
    ]
}

/// The latest verdict in a line, then what else is to be said of it. Text in colours as
/// elsewhere, but the colours of a terminal are not those of ratatui.
fn verdict(view: &View) -> Vec<Line<'static>> {
    if let Some(lines) = view.status.punched_lines {
        let said = Span::styled(text::punched(lines), CAUTION);
        return vec![latest("verdict", said)];
    }
    let Some(verdict) = &view.verdict else {
        return vec![latest("verdict", Span::styled("none yet", FAINT))];
    };
    let said = umi_report::terminal::ink::plain(&text::verdict(verdict));
    let mut said = said.lines().map(str::to_owned);
    let mut style = if verdict.ok { GOOD } else { BAD };
    let mut first = said.next().unwrap_or_default();
    let since = if view.reference_is_forgotten() {
        Some("the reference is forgotten: NG until another setup has taught")
    } else {
        match view.correction() {
            Some(Correction::WentOut) => {
                first += "; its correction went out";
                None
            }
            Some(Correction::Gone) => Some("its correction waits no more: READ gets an alarm"),
            Some(Correction::Waits) | None => None,
        }
    };
    if let Some(since) = since {
        // What it was stands behind what is true now.
        first = format!("{since} (it was {first})");
        style = CAUTION;
    }
    let mut first = latest("verdict", Span::styled(first, style));
    if view.status.access == AccessMode::Open {
        // Whoever reaches the board may have set what it judges by.
        first.spans.insert(1, Span::styled("open board, ", CAUTION));
    }
    [first].into_iter().chain(said.map(Line::raw)).collect()
}

/// What is to be taught and has not been.
fn teaching(view: &View) -> Option<Line<'static>> {
    let status = &view.status;
    let said = text::teaching(status.teaching.as_ref()?, status.uptime_us);
    let name = Span::styled(format!("{:<16}", "to be taught"), FAINT);
    Some(Line::from(vec![name, Span::styled(said, CAUTION)]))
}

/// What is to be set, where the probe's line rests at the level of a touch.
fn wrong_level(view: &View) -> Option<Line<'static>> {
    let said = view.skip.wrong_level()?;
    let name = Span::styled(format!("{:<16}", "skip line"), FAINT);
    Some(Line::from(vec![name, Span::styled(said, BAD)]))
}

/// The hits since this began, the newest first and named as such.
fn hits(view: &View) -> Vec<Line<'static>> {
    let mut hits = view.hits.iter().map(hit);
    let newest = match hits.next() {
        Some(hit) => Span::raw(hit),
        None => Span::styled("none since this began", FAINT),
    };
    let newest = latest("hit", newest);
    [newest].into_iter().chain(hits.map(Line::raw)).collect()
}

fn latest(name: &str, said: Span<'static>) -> Line<'static> {
    let name = Span::styled(format!("latest {name:<9}"), FAINT);
    Line::from(vec![name, said])
}

fn hit(hit: &HitReport) -> String {
    let [x, y, z] = hit.position_mm;
    let feature = hit.feature.as_deref().unwrap_or("?");
    let approach = hit.approach.map_or("", text::approach);
    let feed = hit
        .feed_mm_per_min
        .map_or(String::new(), |feed| format!("F{feed:.0}"));
    format!("{feature:<10} {x:>11.4} {y:>11.4} {z:>11.4} mm  {approach:<3} {feed}")
}

#[cfg(test)]
mod tests;
