//! What happens when a signal asks the program to end: Ctrl-C, SIGTERM, or a terminal that is closed. While a [`Stop`]
//! lives, the first signal sets its flag, so that the work that looks at the flag ends in order. Any other signal ends
//! the program at once; on Unix, the unfinished files of every [`Output`](crate::report::Output) are removed before. A
//! signal that is ignored when the program begins, as by `nohup`, stays ignored. In a process of another program, such as
//! Python, nothing is done with signals.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use palpate::{Error, Result};

struct State {
    stops: Vec<Waiting>,
    unfinished: Vec<Arc<Unfinished>>,
    is_program: bool,
    is_listening: bool,
}

/// A flag that the next signal sets.
struct Waiting {
    flag: Arc<AtomicBool>,
    /// Whether a signal that suspends the program sets the flag too; only Unix has one.
    #[cfg_attr(not(unix), allow(dead_code))]
    takes_suspend: bool,
}

static STATE: Mutex<State> =
    Mutex::new(State { stops: Vec::new(), unfinished: Vec::new(), is_program: false, is_listening: false });

fn state() -> MutexGuard<'static, State> {
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Says that this process is the program `palpate`, whose signals are handled here.
pub fn this_is_the_program() {
    state().is_program = true;
}

/// A flag that the first signal sets while this value lives; a second signal ends the program.
pub struct Stop {
    flag: Arc<AtomicBool>,
    #[cfg(not(unix))]
    registered: Vec<signal_hook::SigId>,
}

impl Stop {
    /// A flag for signals that end programs.
    pub fn new() -> Result<Stop> {
        Self::made(false)
    }

    /// A flag that a terminal's suspension of the program sets too: suspended, the program would leave the last force
    /// on a haptic device.
    pub fn or_suspended() -> Result<Stop> {
        Self::made(true)
    }

    fn made(takes_suspend: bool) -> Result<Stop> {
        let mut state = listening()?;
        let flag = Arc::new(AtomicBool::new(false));
        state.stops.push(Waiting { flag: flag.clone(), takes_suspend });
        Ok(Stop {
            #[cfg(not(unix))]
            registered: received::set(&flag).map_err(no_handlers)?,
            flag,
        })
    }

    /// Whether a signal has come.
    pub fn is_set(&self) -> bool {
        self.flag.load(Ordering::Relaxed)
    }

    /// The flag itself.
    pub fn flag(&self) -> Arc<AtomicBool> {
        self.flag.clone()
    }
}

impl Drop for Stop {
    fn drop(&mut self) {
        state().stops.retain(|waiting| !Arc::ptr_eq(&waiting.flag, &self.flag));
        #[cfg(not(unix))]
        self.registered.drain(..).for_each(|id| drop(signal_hook::low_level::unregister(id)));
    }
}

/// A folder of unfinished files, with a file that is locked while they are written.
pub struct Unfinished {
    pub folder: PathBuf,
    /// Name of the locked file.
    pub lock: &'static str,
    /// Folders made for it, outermost first.
    pub made: Vec<PathBuf>,
}

impl Unfinished {
    /// Removes the files, then the locked one, then the folder and those of the folders made for it that are empty. In
    /// this order another run can take the folder over only when nothing of this one is left. What cannot be removed
    /// stays.
    fn remove(&self) {
        for entry in fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            if entry.file_name() != self.lock {
                let _ = fs::remove_file(entry.path());
            }
        }
        let _ = fs::remove_file(self.folder.join(self.lock));
        for folder in std::iter::once(&self.folder).chain(self.made.iter().rev()) {
            let _ = fs::remove_dir(folder);
        }
    }
}

/// An [`Unfinished`] that is removed when this value is dropped, or when a signal ends the program before that.
pub struct Temporary {
    unfinished: Arc<Unfinished>,
    /// The locked file; `None` on a file system without locks.
    _lock: Option<File>,
}

impl Temporary {
    /// Makes the folder by `make`, which returns it with its locked file. No signal comes between the two.
    pub fn new(make: impl FnOnce() -> Result<(Unfinished, Option<File>)>) -> Result<Temporary> {
        let mut state = listening()?;
        let (unfinished, lock) = make()?;
        let unfinished = Arc::new(unfinished);
        state.unfinished.push(unfinished.clone());
        Ok(Temporary { unfinished, _lock: lock })
    }

    /// The folder of unfinished files.
    pub fn folder(&self) -> &Path {
        &self.unfinished.folder
    }

    /// Moves files out of the folder by `work`, which no signal cuts short, and then removes the folder.
    pub fn finish(self, work: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
        let guard = state();
        let done = work(&self.unfinished.folder);
        drop(guard);
        done
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let mut state = state();
        state.unfinished.retain(|other| !Arc::ptr_eq(other, &self.unfinished));
        self.unfinished.remove();
    }
}

/// The state, in the program with signals being received.
fn listening() -> Result<MutexGuard<'static, State>> {
    let mut state = state();
    if state.is_program && !state.is_listening {
        received::begin().map_err(no_handlers)?;
        state.is_listening = true;
    }
    Ok(state)
}

fn no_handlers(error: io::Error) -> Error {
    Error::Simulation(format!("cannot install signal handlers: {error}"))
}

#[cfg(unix)]
mod received {
    use std::thread;

    use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGTSTP};
    use signal_hook::iterator::Signals;
    use signal_hook::low_level::emulate_default_handler;

    use super::*;

    /// Number of attempts to remove a folder into which another thread may still be writing.
    const ATTEMPTS: u32 = 20;

    /// Receives signals on a thread of their own, but for those that are ignored.
    pub fn begin() -> io::Result<()> {
        let ignored = ignored(&fs::read_to_string("/proc/self/status").unwrap_or_default());
        let heard = [SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGTSTP].into_iter().filter(|signal| !ignored(*signal));
        let mut signals = Signals::new(heard)?;
        let work = move || signals.forever().for_each(receive);
        thread::Builder::new().name("signals".into()).spawn(work).map(drop)
    }

    /// Whether a signal is ignored, by Linux's description of the process; on other systems none is known to be.
    pub fn ignored(description: &str) -> impl Fn(i32) -> bool + use<> {
        let mask = description.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        let mask = mask.and_then(|digits| u64::from_str_radix(digits.trim(), 16).ok()).unwrap_or(0);
        move |signal| mask >> (signal - 1) & 1 == 1
    }

    fn receive(signal: i32) {
        let state = state();
        let suspends = signal == SIGTSTP;
        let unset = |waiting: &&Waiting| (!suspends || waiting.takes_suspend) && !waiting.flag.load(Ordering::Relaxed);
        let waiting: Vec<_> = state.stops.iter().filter(unset).collect();
        if !waiting.is_empty() {
            waiting.iter().for_each(|waiting| waiting.flag.store(true, Ordering::Relaxed));
        } else if suspends {
            drop(state);
            let _ = emulate_default_handler(signal);
        } else {
            // The lock is kept, so that no file moves to its final name any more.
            for _ in 0..ATTEMPTS {
                state.unfinished.iter().for_each(|unfinished| unfinished.remove());
                if !state.unfinished.iter().any(|unfinished| unfinished.folder.exists()) {
                    break;
                }
                thread::yield_now();
            }
            let _ = emulate_default_handler(signal);
        }
    }
}

#[cfg(not(unix))]
mod received {
    use signal_hook::SigId;
    use signal_hook::consts::TERM_SIGNALS;

    use super::*;

    /// Here each flag is registered by itself; see [`set`].
    pub fn begin() -> io::Result<()> {
        Ok(())
    }

    /// Lets the first signal set the flag, and the second end the program.
    pub fn set(flag: &Arc<AtomicBool>) -> io::Result<Vec<SigId>> {
        let mut registered = Vec::new();
        for signal in TERM_SIGNALS {
            registered.push(signal_hook::flag::register_conditional_default(*signal, flag.clone())?);
            registered.push(signal_hook::flag::register(*signal, flag.clone())?);
        }
        Ok(registered)
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::received::ignored;

    #[test]
    fn signals_that_are_ignored_are_read_from_the_mask() {
        let ignored = ignored("Name:\tpalpate\nSigIgn:\t0000000000001001\nSigCgt:\tffffffffffffffff\n");
        assert!([1, 13].into_iter().all(&ignored) && ![2, 15].into_iter().any(&ignored));
    }
}
