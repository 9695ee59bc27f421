//! The terminal's screen: drawn ten times a second, restored at the end.

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

/// Shows a board until somebody presses q, or the terminal or the input is gone.
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
    interrupt::end_with_input();
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
    let mut page = Ok(Page::Board);
    while let Ok(Page::Board | Page::Help) = page
        && !interrupt::came()
        && !asking.is_finished()
    {
        page = page.and_then(|page| picture(&mut terminal, &look(), page));
    }
    ratatui::restore();
    page.map_err(trouble)?;
    if asking.is_finished() {
        return Err(Failure::trouble(
            "internal",
            "what asks the board has failed: please report this fault",
        ));
    }
    Ok(())
}

/// What is shown.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Page {
    Board,
    Help,
    End,
}

/// One picture and the keys up to the next; the page that is then shown.
fn picture(terminal: &mut DefaultTerminal, view: &super::View, page: Page) -> io::Result<Page> {
    terminal.draw(|frame| match page {
        Page::Help => screen::help(frame.area(), frame.buffer_mut()),
        _ => screen::draw(view, frame.area(), frame.buffer_mut()),
    })?;
    if !event::poll(TURN)? {
        return Ok(page);
    }
    // A new size of the terminal is seen by the next picture.
    let Event::Key(key) = event::read()? else {
        return Ok(page);
    };
    let control_c = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
    Ok(match key.code {
        _ if key.kind != KeyEventKind::Press => page,
        _ if control_c => Page::End,
        KeyCode::Char('q' | 'Q') => Page::End,
        _ if page == Page::Help => Page::Board,
        KeyCode::Esc => Page::End,
        KeyCode::Char('?' | 'h' | 'H') => Page::Help,
        _ => page,
    })
}

fn trouble(error: io::Error) -> Failure {
    Failure::trouble("terminal", format_args!("the terminal: {error}"))
}
