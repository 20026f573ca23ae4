//! Handles: which of them live, and what they stand for. The one thing that all of a process share.
//!
//! A handle is the number of a slot and how often that slot was used before. One that was destroyed no longer has the slot's
//! count, however the slot is used again; a slot whose count runs out is used no more.

use std::any::Any;
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};

use super::status::{Failure, Outcome, palpate_status};

/// Bits of a slot's number in a handle; the count has the others.
const SLOT_BITS: u32 = usize::BITS / 2;

/// What a handle can stand for.
pub(super) trait Handled: Send + 'static {
    /// In messages.
    const NAME: &str;
}

type Shared = Arc<dyn Any + Send + Sync>;

/// What a handle stands for.
struct Held<T> {
    object: Mutex<T>,
    /// Why it can only be used by whom it was lent to.
    lent: Mutex<Option<&'static str>>,
    /// Its companion.
    beside: Shared,
}

impl<T> Held<T> {
    fn lent(&self) -> MutexGuard<'_, Option<&'static str>> {
        self.lent.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

/// A slot, and what it holds.
#[derive(Default)]
struct Slot {
    /// How often it was used, this time included.
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
    // It is whole between any two of its statements.
    TABLE.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// A new handle.
pub(super) fn insert<T: Handled>(object: T) -> usize {
    insert_with(object, Arc::new(()))
}

/// A new handle of something with a companion, which any number of threads may use at once, whoever is at the thing itself.
pub(super) fn insert_with<T: Handled>(object: T, beside: Shared) -> usize {
    let mut table = table();
    let slot = table.free.pop().unwrap_or_else(|| {
        table.slots.push(Slot::default());
        table.slots.len() - 1
    });
    let held = &mut table.slots[slot];
    held.count += 1;
    held.object = Some(Arc::new(Held { object: Mutex::new(object), lent: Mutex::new(None), beside }));
    held.count << SLOT_BITS | slot
}

/// Takes a handle out of use; what it stood for goes when nobody is at it any more.
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
    // With the table free: what goes may take its time.
    drop(object);
    Ok(())
}

/// Does something with what a handle stands for. Errors: it stands for nothing, or another thread is at it, or it is lent.
pub(super) fn with<T: Handled, R>(handle: usize, work: impl FnOnce(&mut T) -> Outcome<R>) -> Outcome<R> {
    let held = find::<T>(&table(), handle)?.1;
    let mut object = held.try_lock()?;
    work(&mut object)
}

/// Lends what a handle stands for: whoever else comes is told why it cannot be used, until this is let go of. Errors: as
/// [`with`].
pub(super) fn lend<T: Handled>(handle: usize, why: &'static str) -> Outcome<Lent<T>> {
    let held = find::<T>(&table(), handle)?.1;
    {
        let _object = held.try_lock()?;
        *held.lent() = Some(why);
    }
    Ok(Lent(held))
}

/// The companion of what a handle stands for.
pub(super) fn beside<T: Handled, B: Any + Send + Sync>(handle: usize) -> Outcome<Arc<B>> {
    let held = find::<T>(&table(), handle)?.1;
    let other = || Failure::new(palpate_status::Handle, format!("the {} has no such companion", T::NAME));
    Arc::clone(&held.beside).downcast().map_err(|_| other())
}

/// What was lent, for the thread that works with it; it lives as long as this, even where its handle goes.
pub(super) struct Lent<T: Handled>(Arc<Held<T>>);

impl<T: Handled> Lent<T> {
    pub fn lock(&self) -> MutexGuard<'_, T> {
        // Poisoned by a panic of the borrower's own, who knows of it.
        self.0.object.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

impl<T: Handled> Drop for Lent<T> {
    fn drop(&mut self) {
        *self.0.lent() = None;
    }
}

impl<T: Handled> Held<T> {
    fn try_lock(&self) -> Outcome<MutexGuard<'_, T>> {
        let busy = |why: &str| Failure::new(palpate_status::Busy, format!("the {} is in use by {why}", T::NAME));
        match (self.object.try_lock(), *self.lent()) {
            (Err(TryLockError::Poisoned(_)), _) => Err(Failure::new(
                palpate_status::Fault,
                format!("an earlier call was lost amid the {0}; destroy the {0}", T::NAME),
            )),
            (_, Some(why)) => Err(busy(why)),
            (Err(TryLockError::WouldBlock), None) => Err(busy("another call; wait for that, one thread at a time")),
            (Ok(object), None) => Ok(object),
        }
    }
}

fn find<T: Handled>(table: &Table, handle: usize) -> Outcome<(usize, Arc<Held<T>>)> {
    if handle == 0 {
        return Err(Failure::new(palpate_status::Null, format!("the {0} is null; create a {0}", T::NAME)));
    }
    let (slot, count) = (handle & (usize::MAX >> SLOT_BITS), handle >> SLOT_BITS);
    let held = table.slots.get(slot).filter(|held| held.count == count);
    let Some(object) = held.and_then(|held| held.object.clone()) else {
        let problem = format!("the {} was destroyed, or never created", T::NAME);
        return Err(Failure::new(palpate_status::Handle, problem));
    };
    let other = || Failure::new(palpate_status::Handle, format!("the handle is of no {}", T::NAME));
    Ok((slot, object.downcast::<Held<T>>().map_err(|_| other())?))
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
