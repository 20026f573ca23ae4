//! The table of handles. A handle is what a C caller holds in place of a pointer to an object; the table tells which
//! handles are alive, and which objects they stand for. The table is the only state that the whole process shares.
//!
//! A handle is a number. Its low half is the index of a slot of the table; its high half is the slot's generation, that
//! is, how often the slot had been used when the handle was made. The handle of a destroyed object keeps its old
//! generation, so it stays invalid when the slot is used for another object. A slot whose generation would overflow is
//! not used again.

use std::any::Any;
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};

use super::status::{Failure, Outcome, palpate_status};

/// Number of low bits of a handle that hold the index of the slot; the other bits hold the generation (`count`).
const SLOT_BITS: u32 = usize::BITS / 2;

/// An object that a handle can stand for.
pub(super) trait Handled: Send + 'static {
    /// Name of this kind of object in messages.
    const NAME: &str;
}

type Shared = Arc<dyn Any + Send + Sync>;

/// The object of a handle, with the data that the table stores along with it.
struct Owned<T> {
    object: Mutex<T>,
    /// While the object is lent to one user (see `lend`): the reason that the errors of other callers give.
    lent: Mutex<Option<&'static str>>,
    /// The companion: data that any thread may use while another works with the object.
    beside: Shared,
}

impl<T> Owned<T> {
    fn lent(&self) -> MutexGuard<'_, Option<&'static str>> {
        self.lent.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

/// A slot of the table.
#[derive(Default)]
struct Slot {
    /// Generation: how often the slot has been used, the present use included.
    count: usize,
    object: Option<Shared>,
}

#[derive(Default)]
struct Table {
    slots: Vec<Slot>,
    free: Vec<usize>,
}

static TABLE: Mutex<Table> = Mutex::new(Table { slots: Vec::new(), free: Vec::new() });

fn table() -> MutexGuard<'static, Table> {
    // A panic cannot leave the table half-changed: while it is locked, it is consistent between any two statements.
    TABLE.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Stores an object and returns its new handle.
pub(super) fn insert<T: Handled>(object: T) -> usize {
    insert_with(object, Arc::new(()))
}

/// Stores an object with a companion and returns the object's new handle. Any number of threads may use the companion
/// at once, even while a thread uses the object.
pub(super) fn insert_with<T: Handled>(object: T, beside: Shared) -> usize {
    let mut table = table();
    let slot = table.free.pop().unwrap_or_else(|| {
        table.slots.push(Slot::default());
        table.slots.len() - 1
    });
    let held = &mut table.slots[slot];
    held.count += 1;
    held.object = Some(Arc::new(Owned { object: Mutex::new(object), lent: Mutex::new(None), beside }));
    held.count << SLOT_BITS | slot
}

/// Invalidates a handle. Its object is dropped as soon as no thread uses it any more.
pub(super) fn remove<T: Handled>(handle: usize) -> Outcome {
    let object = {
        let mut table = table();
        let slot = find::<T>(&table, handle)?.0;
        let held = &mut table.slots[slot];
        let object = held.object.take();
        if held.count < usize::MAX >> SLOT_BITS {
            table.free.push(slot);
        }
        object
    };
    // The object is dropped only here, with the table's lock released, because dropping it may take long.
    drop(object);
    Ok(())
}

/// Runs `work` on the object of a handle. Errors: the handle stands for no object of type `T`, another thread uses the
/// object, the object is lent, or an earlier call panicked while it used the object.
pub(super) fn with<T: Handled, R>(handle: usize, work: impl FnOnce(&mut T) -> Outcome<R>) -> Outcome<R> {
    let held = find::<T>(&table(), handle)?.1;
    let mut object = held.try_lock()?;
    work(&mut object)
}

/// Lends the object of a handle to one user: until the result is dropped, other callers are refused with the reason
/// `why`. Errors: those of [`with`].
pub(super) fn lend<T: Handled>(handle: usize, why: &'static str) -> Outcome<Lent<T>> {
    let held = find::<T>(&table(), handle)?.1;
    {
        let _object = held.try_lock()?;
        *held.lent() = Some(why);
    }
    Ok(Lent(held))
}

/// Returns the companion that was stored with the object of a handle.
pub(super) fn beside<T: Handled, B: Any + Send + Sync>(handle: usize) -> Outcome<Arc<B>> {
    let held = find::<T>(&table(), handle)?.1;
    let other = || Failure::new(palpate_status::Handle, format!("internal error: wrong companion of the {}", T::NAME));
    Arc::clone(&held.beside).downcast().map_err(|_| other())
}

/// A lent object, for the thread that works with it. The object lives at least as long as this value, even if its
/// handle is removed.
pub(super) struct Lent<T: Handled>(Arc<Owned<T>>);

impl<T: Handled> Lent<T> {
    pub fn lock(&self) -> MutexGuard<'_, T> {
        // Only a panic of the borrower can have poisoned the lock, and the borrower itself reports such a panic.
        self.0.object.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

impl<T: Handled> Drop for Lent<T> {
    fn drop(&mut self) {
        *self.0.lent() = None;
    }
}

impl<T: Handled> Owned<T> {
    fn try_lock(&self) -> Outcome<MutexGuard<'_, T>> {
        let busy = |why: &str| Failure::new(palpate_status::Busy, format!("the {} is in use by {why}", T::NAME));
        match (self.object.try_lock(), *self.lent()) {
            (Err(TryLockError::Poisoned(_)), _) => Err(Failure::new(
                palpate_status::Fault,
                format!("an earlier call that used the {0} panicked; destroy the {0}", T::NAME),
            )),
            (_, Some(why)) => Err(busy(why)),
            (Err(TryLockError::WouldBlock), None) => Err(busy("another call; wait until that returns")),
            (Ok(object), None) => Ok(object),
        }
    }
}

fn find<T: Handled>(table: &Table, handle: usize) -> Outcome<(usize, Arc<Owned<T>>)> {
    if handle == 0 {
        return Err(Failure::new(palpate_status::Null, format!("the {0} is null; create a {0}", T::NAME)));
    }
    let (slot, count) = (handle & (usize::MAX >> SLOT_BITS), handle >> SLOT_BITS);
    let held = table.slots.get(slot).filter(|held| held.count == count);
    let Some(object) = held.and_then(|held| held.object.clone()) else {
        let problem = format!("the {} was destroyed, or never created", T::NAME);
        return Err(Failure::new(palpate_status::Handle, problem));
    };
    let other = || Failure::new(palpate_status::Handle, format!("the handle is not that of a {}", T::NAME));
    Ok((slot, object.downcast::<Owned<T>>().map_err(|_| other())?))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Apple(u32);
    struct Pear;

    impl Handled for Apple {
        const NAME: &str = "apple";
    }

    impl Handled for Pear {
        const NAME: &str = "pear";
    }

    fn status<T: Handled>(handle: usize) -> palpate_status {
        with::<T, ()>(handle, |_| Ok(())).map_or_else(|failure| failure.status, |()| palpate_status::Ok)
    }

    #[test]
    fn a_handle_stands_for_one_thing_until_it_is_removed() {
        let handle = insert(Apple(7));
        assert_eq!(with(handle, |apple: &mut Apple| Ok(apple.0)).unwrap(), 7);
        assert_eq!(status::<Pear>(handle), palpate_status::Handle);
        assert_eq!(remove::<Pear>(handle).unwrap_err().status, palpate_status::Handle);
        remove::<Apple>(handle).unwrap();
        let other = insert(Apple(8));
        assert_ne!(handle, other);
        for gone in [handle, 1, 12345, usize::MAX] {
            assert_eq!(status::<Apple>(gone), palpate_status::Handle);
        }
        assert_eq!(status::<Apple>(0), palpate_status::Null);
        assert_eq!(remove::<Apple>(handle).unwrap_err().status, palpate_status::Handle);
        remove::<Apple>(other).unwrap();
    }

    #[test]
    fn one_thread_at_a_time_and_none_after_a_fault() {
        let handle = insert(Apple(0));
        let inner = with(handle, |_: &mut Apple| Ok(status::<Apple>(handle))).unwrap();
        assert_eq!(inner, palpate_status::Busy);
        let thread = std::thread::spawn(move || with::<Apple, ()>(handle, |_| panic!("on purpose")));
        assert!(thread.join().is_err());
        assert_eq!(status::<Apple>(handle), palpate_status::Fault);
        remove::<Apple>(handle).unwrap();
    }

    #[test]
    fn what_is_removed_while_in_use_goes_afterwards() {
        let handle = insert(Apple(3));
        let left = with(handle, |apple: &mut Apple| {
            remove::<Apple>(handle)?;
            Ok(apple.0)
        });
        assert_eq!(left.unwrap(), 3);
        assert_eq!(status::<Apple>(handle), palpate_status::Handle);
    }

    #[test]
    fn what_is_lent_is_the_borrowers_alone_until_it_is_given_back() {
        let handle = insert_with(Apple(1), Arc::new(5u8));
        let lent = lend::<Apple>(handle, "a worm; wait").unwrap();
        let refused = with::<Apple, ()>(handle, |_| Ok(())).unwrap_err();
        assert_eq!(
            (refused.status, refused.message.as_str()),
            (palpate_status::Busy, "the apple is in use by a worm; wait")
        );
        assert_eq!(lend::<Apple>(handle, "a wasp").err().unwrap().status, palpate_status::Busy);
        lent.lock().0 += 1;
        assert_eq!(*beside::<Apple, u8>(handle).unwrap(), 5);
        assert_eq!(beside::<Apple, u16>(handle).unwrap_err().status, palpate_status::Handle);
        drop(lent);
        assert_eq!(with(handle, |apple: &mut Apple| Ok(apple.0)).unwrap(), 2);
        let lent = lend::<Apple>(handle, "a worm; wait").unwrap();
        remove::<Apple>(handle).unwrap();
        assert_eq!(lent.lock().0, 2);
    }
}
