//! `umi update`: a board gets a signed image, tries it, and keeps it or goes back.

pub(in crate::cmd) mod image;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use umi_client::board::link::Client;
use umi_client::board::port;
use umi_client::files::image_file::{self, Image, version_text};
use umi_client::problem::Problem;
use umi_protocol::program::MAX_PIECE;
use umi_protocol::update::{ImageInfo, ImagePlace, UpdateRefusal, UpdateState};

use crate::cmd::{Board, Format};
use crate::failure::Failure;
use crate::show::terminal::{GOOD, paint, print, print_json};

/// How long a board may take to start, to try the image, and to start again if it goes back.
const PATIENCE: Duration = Duration::from_secs(60);

/// How often it is asked meanwhile.
const TURN: Duration = Duration::from_millis(200);

/// How often an update is begun anew that the board does not know any more.
const TRIES: u32 = 3;

/// Give a board a signed image, and wait until it runs
#[derive(Args)]
#[command(after_help = "\
The board verifies the image before it counts, starts it on trial, and keeps it if it passes its
self-test; else the one before runs again (`image_not_confirmed`). It takes no image while a
clamping is measured, a program is on its way or an axis moves (`board_busy`). A board that has an
owner takes images by an owner's key only. A Pico runs its image from one of two places, and each has
an image of its own: give both, and the board gets the one for the place that is free.

Examples:
  umi update virtual.umif
  umi update pico-a.umif pico-b.umif
  umi update virtual.umif --port /dev/ttyACM0 --key anna")]
pub(crate) struct Update {
    /// The image, as `umi image sign` wrote it; or one for each place
    #[arg(value_name = "FILE.umif", required = true)]
    files: Vec<PathBuf>,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

impl Update {
    pub fn run(self) -> Result<(), Failure> {
        let images: Vec<Image> = self
            .files
            .iter()
            .map(|file| image_file::read(file))
            .collect::<Result<_, _>>()?;
        let mut board = self.board.connect()?;
        let Some(before) = board.image()? else {
            return Err(Failure::refused(
                "not_on_this_board",
                "this board takes no images over this line: see its README for how its firmware is replaced",
            ));
        };
        let image = send(&mut board, &images, &before)?;
        drop(board);
        let after = comes_to_rest(self.board.address())?;
        let (from, to) = (
            version_text(before.version),
            version_text(image.header.version),
        );
        let runs = after.sha512.map(|halves| halves.concat());
        if after.latest != UpdateState::Confirmed || runs.as_deref() != Some(&image.header.sha512) {
            let runs = version_text(after.version);
            let message = format_args!(
                "the image {to} did not confirm itself on this board: {runs} runs again"
            );
            let problem = Problem::refused("image_not_confirmed", message);
            return Err(problem
                .with("from", from)
                .with("to", to)
                .with("runs", runs)
                .into());
        }
        if self.format.json {
            return print_json(&json!({"from": from, "to": to, "state": after.latest}));
        }
        let done = format!("image {to} runs and is confirmed, in place of {from}");
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

/// Sends the first image that is for this board and its free place; which.
fn send<'i>(
    board: &mut Client,
    images: &'i [Image],
    before: &ImageInfo,
) -> Result<&'i Image, Problem> {
    let mut why = Problem::trouble("usage", "no image is given");
    for image in images {
        let Err(refusal) = whole(board, image)? else {
            return Ok(image);
        };
        why = refused(refusal, image, before);
        if refusal != UpdateRefusal::Board {
            break;
        }
    }
    Err(why)
}

/// Sends an image to its end.
fn whole(board: &mut Client, image: &Image) -> Result<Result<(), UpdateRefusal>, Problem> {
    let style = ProgressStyle::with_template("{bytes:>10} of {total_bytes} {wide_bar} {eta}");
    let bar = ProgressBar::new(image.header.length.into())
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let mut left = TRIES;
    let done = loop {
        match pieces(board, image, &bar)? {
            // It has started anew meanwhile.
            Err(UpdateRefusal::NotBegun) if left > 1 => left -= 1,
            done => break done,
        }
    };
    bar.finish_and_clear();
    Ok(done)
}

fn pieces(
    board: &mut Client,
    image: &Image,
    bar: &ProgressBar,
) -> Result<Result<(), UpdateRefusal>, Problem> {
    let mut at = match board.update_begin(&image.header_bytes)? {
        Ok(at) => at.unwrap_or_default(),
        Err(refusal) => return Ok(Err(refusal)),
    };
    while let Some(rest) = image.payload.get(at as usize..).filter(|of| !of.is_empty()) {
        bar.set_position(at.into());
        let piece = rest.iter().take(MAX_PIECE).copied().collect();
        match board.update_piece(at, piece)? {
            Ok(next) if next != at => at = next,
            // It would never end.
            Ok(_) => return Ok(Err(UpdateRefusal::NotBegun)),
            Err(refusal) => return Ok(Err(refusal)),
        }
    }
    Ok(board.update_end()?)
}

/// Why an image is not taken, with what it is held against.
fn refused(refusal: UpdateRefusal, image: &Image, before: &ImageInfo) -> Problem {
    let (place, other) = match before.place {
        ImagePlace::A => ("a", "b"),
        ImagePlace::BuiltIn | ImagePlace::B => ("b", "a"),
    };
    // One that is built for a place says so at the end of its board's name.
    let kind = image.header.board.strip_suffix(&format!("-{place}"));
    let problem = match kind {
        Some(kind) if refusal == UpdateRefusal::Board => {
            let message = format_args!(
                "the image is built for place {place}, and the board runs from there: give the one for {kind}-{other}, or both files"
            );
            Problem::refused(refusal.code(), message)
        }
        _ => Problem::refused(refusal.code(), refusal),
    };
    match refusal {
        UpdateRefusal::Rollback => problem
            .with("version", version_text(before.version))
            .with("counter", before.counter),
        UpdateRefusal::TooLong { most_bytes } => problem.with("most_bytes", most_bytes),
        _ => problem,
    }
}

/// Waits until a board that starts anew has tried its image.
fn comes_to_rest(address: Option<&str>) -> Result<ImageInfo, Problem> {
    let until = Instant::now() + PATIENCE;
    loop {
        std::thread::sleep(TURN);
        let came = port::connect(address).and_then(|mut board| Ok(board.image()?));
        match came {
            Ok(Some(image)) if image.latest != UpdateState::Trial => return Ok(image),
            _ if Instant::now() < until => {}
            Err(problem) => return Err(problem),
            Ok(_) => {
                let message = "the board has not ended the trial of the image within a minute: look at it, and ask `umi info`";
                return Err(Problem::trouble("image_on_trial", message));
            }
        }
    }
}
