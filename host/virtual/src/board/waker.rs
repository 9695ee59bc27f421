//! One waker for all that a board waits for.
//!
//! # Design
//!
//! A signal of `embassy-sync` keeps the waker that it was polled with last. Where another one
//! polls it, it wakes the one before, so that both look again. Two wakers are told apart by
//! their tables, too (`Waker::will_wake`), and a release build may have that of tokio's runtime
//! twice: the signal then takes the runtime's waker and its own copy of it for two, and a board
//! at rest took a whole core. A copy of a copy is like it.

use std::future::poll_fn;
use std::pin::pin;
use std::task::{Context, Waker};

/// Copies until a copy is like what it was made of: one was enough wherever it was tried.
const COPIES: usize = 4;

/// Runs a future with one waker, which wakes the runtime that polls it.
pub(super) async fn with_one_waker<F: Future>(future: F) -> F::Output {
    let mut future = pin!(future);
    let mut one: Option<Waker> = None;
    poll_fn(|cx| {
        let waker = one.get_or_insert_with(|| settled(cx.waker()));
        future.as_mut().poll(&mut Context::from_waker(waker))
    })
    .await
}

fn settled(of: &Waker) -> Waker {
    let mut waker = of.clone();
    for _ in 0..COPIES {
        let copy = waker.clone();
        if copy.will_wake(&waker) {
            break;
        }
        waker = copy;
    }
    waker
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::task::Poll;

    /// What is kept at one poll is the waker of the next one. (It fails without [`settled`] in a
    /// release build alone.)
    #[test]
    fn a_kept_waker_is_that_of_the_next_poll() {
        let mut kept: Option<Waker> = None;
        let mut polls = 0;
        let looks = poll_fn(|cx| {
            if let Some(kept) = &kept {
                assert!(kept.will_wake(cx.waker()), "poll {polls}");
            }
            kept = Some(cx.waker().clone());
            polls += 1;
            if polls == 5 {
                return Poll::Ready(());
            }
            cx.waker().wake_by_ref();
            Poll::Pending
        });
        let runtime = tokio::runtime::Builder::new_current_thread().build();
        runtime.unwrap().block_on(with_one_waker(looks));
        assert_eq!(polls, 5);
    }
}
