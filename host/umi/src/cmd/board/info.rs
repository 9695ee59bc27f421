//! `umi info`

use crate::failure::Failure;
use crate::show::json;
use crate::show::terminal::{
    BAD, CAUTION, FAINT, GOOD, PLAIN, TITLE, Table, count, loss_style, one_line, paint, print,
    print_json,
};
use crate::show::text::{clock, punched, reset, reset_style, teaching};
use clap::Args;
use serde_json::json;
use umi_client::axes::{NAMES, Scale};
use umi_protocol::fault::FaultCode;
use umi_protocol::hello::{KEY, VERSION};
use umi_protocol::job::Doubt;
use umi_protocol::latch::{LatchCounters, Positions};
use umi_protocol::message::{AccessMode, Identity, JobLoss, JournalInfo, Status};
use umi_protocol::update::{ImageInfo, ImagePlace};

use crate::cmd::{Board, Format};

use super::access::unless_locked;

/// Show who a board is, what it does and what it has counted
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Info {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Examples:
  umi info                              the only board that is plugged in
  umi info --port /dev/ttyACM0
  umi info --port tcp://localhost:7001 --json
  UMI_PORT=COM3 umi info

A board of another version is not talked to; the error says which side to update.";

impl Info {
    pub fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let identity = board.identity()?;
        let status = board.status()?;
        // Who asks without a key is not refused: that would be a record.
        let reads = status.access == AccessMode::Open || board.has_session();
        let journal = reads.then(|| unless_locked(board.journal_info()));
        let journal = journal.transpose()?.flatten();
        let image = board.image()?;
        let positions = board.positions()?;
        // Where its owner lets nobody read, the second would be another record.
        let in_force = journal.map(|_| board.job()).transpose()?;
        let scale = Scale::of(in_force.as_ref().and_then(|of| of.job.as_ref()));
        let unread = in_force.as_ref().map(|of| &of.learned);
        let unread = unread.filter(|of| of.doubt == Doubt::Unread);
        let unread = unread.map(|of| of.run);
        let teachings = in_force.and_then(|of| {
            let further = of.learned.further;
            of.taught_mm.map(|_| 1 + u32::from(further))
        });
        if self.format.json {
            return print_json(&json!({
                "board": json::identity(&identity),
                "protocol": VERSION.to_string(),
                "schema": format!("{KEY:016x}"),
                "umi": env!("CARGO_PKG_VERSION"),
                "status": json::status(&status),
                "teachings": teachings,
                "taught_unread_run": unread,
                "positions": json::positions(&positions, &scale),
                "journal": journal.as_ref().map(json::journal_info),
                "access": { "mode": status.access },
                "image": image.as_ref().map(json::image),
            }));
        }
        print(&text(
            &identity,
            &status,
            (teachings, unread),
            journal,
            image,
        ))?;
        print(&axes(&positions, &scale))?;
        print(&latches(status.latches))?;
        print(&received(&status))
    }
}

fn text(
    identity: &Identity,
    status: &Status,
    (teachings, unread): (Option<u32>, Option<u32>),
    journal: Option<JournalInfo>,
    image: Option<ImageInfo>,
) -> String {
    let mut table = Table::new("<<");
    let Identity {
        board,
        serial,
        firmware,
    } = identity;
    let umi = env!("CARGO_PKG_VERSION");
    table.row(["firmware", firmware.as_str()]);
    if let Some(image) = image {
        let place = match image.place {
            ImagePlace::BuiltIn => "built in",
            ImagePlace::A => "slot a",
            ImagePlace::B => "slot b",
        };
        let (style, state) = match image.confirmed {
            true => (PLAIN, "confirmed"),
            false => (CAUTION, "on trial"),
        };
        let told = format!("{place}, security counter {}, {state}", image.counter);
        table.styled([(PLAIN, "image".to_owned()), (style, told)]);
    }
    table.row([
        "protocol".to_owned(),
        format!("{VERSION}, the same as this umi {umi}"),
    ]);
    let started = format!(
        "{}, started{}",
        clock(status.uptime_us),
        reset(status.reset)
    );
    table.styled([
        (PLAIN, "running for".to_owned()),
        (reset_style(status.reset), started),
    ]);
    table.row(["access", super::access::about(status.access)]);
    table.row(["job", status.job.as_deref().unwrap_or("none")]);
    if let Some(why) = status.job_lost.filter(|why| *why != JobLoss::Absent) {
        table.styled([(PLAIN, String::new()), (CAUTION, why.to_string())]);
    }
    let reference = match teachings {
        Some(n) => format!("taught by {}", count(n.into(), "clamping")),
        None if status.has_reference => "given by the job".to_owned(),
        None => "none yet".to_owned(),
    };
    table.row(["reference".to_owned(), reference]);
    if let Some(run) = unread {
        let said = format!(
            "holds by `umi teach --keep {run}`, or once a control that compares runs has asked for the correction in it"
        );
        table.styled([(PLAIN, String::new()), (CAUTION, said)]);
    }
    if let Some(pending) = &status.teaching {
        let said = teaching(pending, status.uptime_us);
        table.styled([(CAUTION, "teaching".to_owned()), (CAUTION, said)]);
    }
    verdicts(&mut table, status);
    let told = journal.map_or_else(
        || "shown to operators and above (--key)".to_owned(),
        entries,
    );
    table.row(["journal".to_owned(), told]);
    if let Some(journal) = journal.filter(|journal| journal.lost > 0) {
        let lost = count(journal.lost, "entry").replace("entrys", "entries");
        let text = format!(
            "{lost} from {} on overwritten: nobody has said that they are kept elsewhere (umi log ack)",
            journal.acked_seq
        );
        table.styled([(PLAIN, String::new()), (CAUTION, text)]);
    }
    losses(&mut table, status);
    let title = paint(
        TITLE,
        format_args!(
            "board {}, serial number {}",
            one_line(board),
            one_line(serial)
        ),
    );
    format!("{title}\n\n{table}")
}

/// Where the axes are and what their encoders counted wrong.
fn axes(positions: &Positions, scale: &Scale) -> String {
    if positions.counts.is_empty() {
        return format!("\n{}\n", paint(FAINT, "  no axes"));
    }
    let mm = if scale.has_origin() {
        "mm, control's coordinates"
    } else {
        "mm from counter 0"
    };
    let mut table = Table::new("<>>>").titles(&["axis", "counts", mm, "illegal transitions"]);
    for (axis, counts) in positions.counts.iter().enumerate() {
        let illegal = positions.illegal.get(axis).copied().unwrap_or(0);
        let mm = scale
            .mm(axis, *counts)
            .map_or("?".into(), |mm| format!("{mm:.4}"));
        let name = NAMES.get(axis).map(|name| name.to_uppercase());
        table.styled([
            (PLAIN, name.unwrap_or_default()),
            (PLAIN, counts.to_string()),
            (PLAIN, mm),
            (loss_style(illegal), illegal.to_string()),
        ]);
    }
    let lost = positions.lost_samples;
    let samples = if positions.are_valid() {
        "  times at which the board could not keep up: 0".into()
    } else {
        format!(
            "  positions NOT VALID: the board could not keep up {}, and what moved then is \
             not counted; start it anew with the axes at their reference",
            count(lost.into(), "time")
        )
    };
    format!("\n{table}{}\n", paint(loss_style(lost), samples))
}

/// What was captured and lost.
fn latches(latches: LatchCounters) -> String {
    let mut table = Table::new("<>").titles(&["latches", "count"]);
    for (name, n) in [
        ("probe", latches.skips),
        ("trigger", latches.triggers),
        ("trigger pulses captured", latches.outputs),
        ("index marks", latches.indices),
    ] {
        table.row([name.to_owned(), n.to_string()]);
    }
    for (name, n) in [
        ("edges missed", latches.missed),
        ("captured, not told to the host", latches.untold),
    ] {
        table.styled([(PLAIN, name.to_owned()), (loss_style(n), n.to_string())]);
    }
    format!("\n{table}\n")
}

fn verdicts(table: &mut Table, status: &Status) {
    let ng = status.verdicts.saturating_sub(status.verdicts_ok);
    let (style, latest) = match status.last_verdict_ok {
        None => (PLAIN, String::new()),
        Some(true) => (GOOD, ", the latest OK".into()),
        Some(false) => (BAD, ", the latest NG".into()),
    };
    let all = format!("{} OK, {ng} NG{latest}", status.verdicts_ok);
    table.styled([(PLAIN, "verdicts".to_owned()), (style, all)]);
    if let Some(lines) = status.punched_lines {
        table.styled([
            (CAUTION, "no verdict".to_owned()),
            (CAUTION, punched(lines)),
        ]);
    }
    if status.correction_waiting {
        table.row(["correction", "waits for the control to ask for it"]);
    }
}

fn entries(journal: JournalInfo) -> String {
    match journal.next_seq.checked_sub(journal.first_seq) {
        None | Some(0) => format!("empty, the next entry is {}", journal.next_seq),
        Some(n) => format!(
            "{} to {} ({})",
            journal.first_seq,
            journal.next_seq - 1,
            count(n, "entry").replace("entrys", "entries")
        ),
    }
}

fn losses(table: &mut Table, status: &Status) {
    for (name, lost) in [
        ("events not sent", status.events_dropped),
        ("journal failures", status.journal_failures),
        ("damaged frames from here", status.link_damaged),
    ] {
        if lost > 0 {
            table.styled([(PLAIN, name.to_owned()), (BAD, lost.to_string())]);
        }
    }
}

fn received(status: &Status) -> String {
    let counters = &status.counters;
    let mut table = Table::new("<>").titles(&["from the control", "count"]);
    for (name, n) in [
        ("bytes", counters.bytes),
        ("bytes lost", counters.bytes_lost),
        ("lines", counters.lines.into()),
        ("  with data", counters.lines_matched.into()),
        ("  separators", counters.lines_separator.into()),
        ("  of part programs", counters.lines_program.into()),
        ("  not understood", counters.lines_not_understood.into()),
        ("  damaged", counters.lines_damaged.into()),
        ("hits", counters.hits.into()),
    ] {
        table.row([name.to_owned(), n.to_string()]);
    }
    let mut faults = Table::new("<>").titles(&["faults", "count"]);
    let mut any = false;
    for &code in FaultCode::ALL {
        let n = counters.of(code);
        if n > 0 {
            any = true;
            faults.styled([(CAUTION, code.to_string()), (PLAIN, n.to_string())]);
        }
    }
    if any {
        format!("{table}\n{faults}")
    } else {
        format!("{table}\n{}\n", paint(FAINT, "  no faults"))
    }
}
