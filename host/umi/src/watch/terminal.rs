//! The screen of a terminal: drawn ten times a second, given back as it was.

use std::io;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};

use super::{Session, screen};
use crate::failure::Failure;
use crate::interrupt;

/// From one picture to the next.
pub const TURN: Duration = Duration::from_millis(100);

/// Shows a board until somebody presses q.
///
/// The board is asked in a thread of its own: one that does not answer holds up neither
/// the keys nor the picture.
///
/// # Errors
/// The terminal's.
pub fn run(mut session: Session) -> Result<(), Failure> {
    let shared = Arc::new(Mutex::new(session.view().clone()));
    let latest = Arc::clone(&shared);
    interrupt::watch();
    // From here on a panic, also in the other thread, gives the terminal back first.
    let mut terminal = ratatui::try_init().map_err(trouble)?;
    let asking = std::thread::spawn(move || {
        loop {
            session.turn();
            let view = session.view().clone();
            *latest.lock().unwrap_or_else(PoisonError::into_inner) = view;
            std::thread::sleep(TURN / 2);
        }
    });
    let look = || {
        shared
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    };
    let mut ended = Ok(false);
    while matches!(ended, Ok(false)) && !interrupt::came() && !asking.is_finished() {
        ended = picture(&mut terminal, &look());
    }
    ratatui::restore();
    ended.map_err(trouble)?;
    if asking.is_finished() {
        return Err(Failure::trouble(
            "internal",
            "what asks the board has failed: please report this fault",
        ));
    }
    Ok(())
}

/// One picture and the keys up to the next. True: it is to end.
fn picture(terminal: &mut DefaultTerminal, view: &super::View) -> io::Result<bool> {
    terminal.draw(|frame| screen::draw(view, frame.area(), frame.buffer_mut()))?;
    if !event::poll(TURN)? {
        return Ok(false);
    }
    // A new size of the terminal is seen by the next picture.
    let Event::Key(key) = event::read()? else {
        return Ok(false);
    };
    let control_c = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
    let quits = matches!(key.code, KeyCode::Char('q' | 'Q') | KeyCode::Esc) || control_c;
    Ok(key.kind == KeyEventKind::Press && quits)
}

fn trouble(error: io::Error) -> Failure {
    Failure::trouble("terminal", format_args!("the terminal: {error}"))
}
