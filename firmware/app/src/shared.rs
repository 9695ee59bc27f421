//! State that several tasks share, each at a priority of its own.
//!
//! # Design
//!
//! Who finds it locked sleeps until it is free, and all who sleep are woken then. A lock
//! that remembers one sleeper only would let two of them wake each other in turn: above
//! the holder's priority that goes on for ever, since the holder never runs again.

use core::cell::RefCell;
use core::future::poll_fn;
use core::ops::{Deref, DerefMut};
use core::task::Poll;

use embassy_sync::blocking_mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::{Mutex, MutexGuard, TryLockError};
use embassy_sync::waitqueue::MultiWakerRegistration;

/// Tasks that may wait at once: measure, transmit, serve, supervise.
const TASKS: usize = 4;

type Sleepers =
    blocking_mutex::Mutex<CriticalSectionRawMutex, RefCell<MultiWakerRegistration<TASKS>>>;

/// State and who waits for it.
pub(crate) struct Shared<T> {
    state: Mutex<CriticalSectionRawMutex, T>,
    sleepers: Sleepers,
}

/// The state while nobody else has it.
pub(crate) struct Guard<'a, T> {
    // First: it is free before anybody wakes.
    state: MutexGuard<'a, CriticalSectionRawMutex, T>,
    _wake: Wake<'a>,
}

/// Wakes who waits when it goes.
struct Wake<'a>(&'a Sleepers);

impl<T> Shared<T> {
    /// Free.
    pub const fn new(state: T) -> Self {
        let sleepers = RefCell::new(MultiWakerRegistration::new());
        Self {
            state: Mutex::new(state),
            sleepers: blocking_mutex::Mutex::new(sleepers),
        }
    }

    /// Locks it if it is free.
    ///
    /// # Errors
    /// It is not.
    pub fn try_lock(&self) -> Result<Guard<'_, T>, TryLockError> {
        Ok(Guard {
            state: self.state.try_lock()?,
            _wake: Wake(&self.sleepers),
        })
    }

    /// Waits until it is free and locks it.
    pub async fn lock(&self) -> Guard<'_, T> {
        poll_fn(|context| {
            if let Ok(guard) = self.try_lock() {
                return Poll::Ready(guard);
            }
            let waker = context.waker();
            self.sleepers
                .lock(|sleepers| sleepers.borrow_mut().register(waker));
            // It may have become free before anybody knew of this one.
            self.try_lock().map_or(Poll::Pending, Poll::Ready)
        })
        .await
    }
}

impl<T> Deref for Guard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.state
    }
}

impl<T> DerefMut for Guard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.state
    }
}

impl Drop for Wake<'_> {
    fn drop(&mut self) {
        self.0.lock(|sleepers| sleepers.borrow_mut().wake());
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::task::{Context, Waker};
    use std::vec::Vec;

    use core::future::Future as _;
    use core::pin::pin;
    use embassy_futures::block_on;

    use super::*;

    /// Counts how often its task was woken.
    #[derive(Default)]
    struct Woken(AtomicU32);

    impl std::task::Wake for Woken {
        fn wake(self: Arc<Self>) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Two who wait do not wake each other, however often they look; when it is free
    /// both are woken, and each gets it once the other has gone.
    #[test]
    fn who_waits_wakes_nobody() {
        let shared = Shared::new(0);
        let tasks: Vec<Arc<Woken>> = (0..2).map(|_| Arc::default()).collect();
        let woken = || -> Vec<u32> {
            let counts = tasks.iter().map(|task| task.0.load(Ordering::Relaxed));
            counts.collect()
        };
        let wakers: Vec<Waker> = tasks.iter().map(|task| task.clone().into()).collect();
        let (mut a, mut b) = (pin!(shared.lock()), pin!(shared.lock()));
        let mut held = block_on(shared.lock());
        for _ in 0..10 {
            assert!(
                a.as_mut()
                    .poll(&mut Context::from_waker(&wakers[0]))
                    .is_pending()
            );
            assert!(
                b.as_mut()
                    .poll(&mut Context::from_waker(&wakers[1]))
                    .is_pending()
            );
        }
        assert_eq!(woken(), [0, 0]);
        *held += 1;
        drop(held);
        assert_eq!(woken(), [1, 1]);
        let Poll::Ready(first) = b.as_mut().poll(&mut Context::from_waker(&wakers[1])) else {
            panic!("it is free");
        };
        assert!(
            a.as_mut()
                .poll(&mut Context::from_waker(&wakers[0]))
                .is_pending()
        );
        assert_eq!(*first, 1);
        drop(first);
        assert_eq!(woken(), [2, 1]);
        assert!(
            a.as_mut()
                .poll(&mut Context::from_waker(&wakers[0]))
                .is_ready()
        );
    }
}
