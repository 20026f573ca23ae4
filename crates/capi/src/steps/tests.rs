//! Tests of the worker thread that does submitted steps (steps for which the caller does not wait), without a GPU: a
//! substitute for the simulation ends each step as the test orders. The result of a step is a wrench: contact force and
//! torque on the tool, the rigid body that the haptic device leads.

use std::sync::mpsc::{Receiver, Sender, channel};

use super::*;

/// The substitute for the simulation: an object whose step waits for an order of the test, and then succeeds, fails or
/// panics as ordered. When the object is dropped, it sends a message on the channel `gone`.
struct Told {
    orders: Receiver<Order>,
    gone: Sender<()>,
    steps: u64,
    has_failed: bool,
}

enum Order {
    Go,
    Fail,
    Panic,
}

impl Handled for Told {
    const NAME: &str = "servant";
}

impl Drop for Told {
    fn drop(&mut self) {
        let _ = self.gone.send(());
    }
}

impl Stepped for Told {
    fn is_fit(&self) -> Outcome {
        let tired = Failure::new(palpate_status::Simulation, "an earlier step failed");
        if self.has_failed { Err(tired) } else { Ok(()) }
    }

    fn step_to(&mut self, _: &[Pose]) -> Outcome<palpate_wrench> {
        self.steps += 1;
        match self.orders.recv().unwrap() {
            Order::Go => Ok(palpate_wrench { step: self.steps, ..palpate_wrench::unset() }),
            Order::Fail => {
                self.has_failed = true;
                Err(Failure::new(palpate_status::Vulkan, "the device is on fire"))
            }
            Order::Panic => panic!("on purpose"),
        }
    }
}

/// Makes a substitute; returns its handle, its worker thread with the results of its steps, the sender of orders, and
/// the receiver of the message that the substitute was dropped.
fn servant() -> (usize, Arc<Steps<Told>>, Sender<Order>, Receiver<()>) {
    let ((order, orders), (gone, goes)) = (channel(), channel());
    let told = Told { orders, gone, steps: 0, has_failed: false };
    let handle = handles::insert_with(told, Arc::new(Steps::<Told>::default()));
    (handle, handles::beside::<Told, _>(handle).unwrap(), order, goes)
}

fn submit(steps: &Steps<Told>, handle: usize) -> palpate_status {
    steps.submit(handle, None, Instant::now()).map_or_else(|failure| failure.status, |()| palpate_status::Ok)
}

fn is_done(steps: &Steps<Told>) -> bool {
    let (rests, told) = steps.poll();
    told.unwrap();
    rests
}

/// Number of the newest step, and the time since that step was submitted, s.
fn newest(steps: &Steps<Told>) -> (u64, f64) {
    let (mut wrench, mut age) = (palpate_wrench::unset(), 0.0);
    // SAFETY: both pointers lead to live local variables of the right types.
    unsafe { steps.shared.lock().newest.tell(&mut wrench, &mut age) }.unwrap();
    (wrench.step, age)
}

#[test]
fn while_a_step_is_under_way_the_last_wrench_is_told_and_all_else_is_busy() {
    let (handle, steps, order, _goes) = servant();
    assert!(is_done(&steps));
    assert_eq!(newest(&steps), (0, f64::INFINITY));
    for step in 1..4 {
        assert_eq!(submit(&steps, handle), palpate_status::Ok);
        assert!(!is_done(&steps));
        assert_eq!(submit(&steps, handle), palpate_status::Busy);
        let refused = handles::with::<Told, ()>(handle, |_| Ok(())).unwrap_err();
        assert!(
            refused.status == palpate_status::Busy && refused.message.contains("a submitted step"),
            "wrong error: {refused:?}"
        );
        assert_eq!(newest(&steps).0, step - 1);
        order.send(Order::Go).unwrap();
        steps.wait().unwrap();
        assert!(is_done(&steps));
        let (told, age) = newest(&steps);
        assert!(told == step && age >= 0.0 && age.is_finite());
        assert_eq!(handles::with(handle, |told: &mut Told| Ok(told.steps)).unwrap(), step);
    }
    remove::<Told>(handle).unwrap();
}

#[test]
fn a_step_that_fails_is_told_until_the_end_and_leaves_the_last_wrench() {
    let (handle, steps, order, _goes) = servant();
    order.send(Order::Go).unwrap();
    assert_eq!(submit(&steps, handle), palpate_status::Ok);
    steps.wait().unwrap();
    order.send(Order::Fail).unwrap();
    assert_eq!(submit(&steps, handle), palpate_status::Ok);
    for _ in 0..2 {
        assert_eq!(steps.wait().unwrap_err().message, "the device is on fire");
        let (rests, told) = steps.poll();
        assert!(rests && told.unwrap_err().status == palpate_status::Vulkan);
    }
    assert_eq!(newest(&steps).0, 1);
    assert_eq!(submit(&steps, handle), palpate_status::Simulation);
    // When a saved state is restored, the library calls `forget`, which clears the failure and the newest wrench.
    steps.forget();
    assert!(is_done(&steps) && newest(&steps).0 == 0);
    steps.wait().unwrap();
    remove::<Told>(handle).unwrap();
}

#[test]
fn a_step_that_panics_is_told_and_its_object_can_only_go() {
    let (handle, steps, order, goes) = servant();
    order.send(Order::Panic).unwrap();
    assert_eq!(submit(&steps, handle), palpate_status::Ok);
    let told = steps.wait().unwrap_err();
    assert!(told.status == palpate_status::Fault && told.message.contains("on purpose"), "wrong error: {told:?}");
    assert_eq!(submit(&steps, handle), palpate_status::Fault);
    assert_eq!(handles::with::<Told, ()>(handle, |_| Ok(())).unwrap_err().status, palpate_status::Fault);
    remove::<Told>(handle).unwrap();
    goes.recv().unwrap();
}

#[test]
fn removing_waits_for_the_step_that_is_under_way_and_leaves_nothing() {
    for _ in 0..20 {
        let (handle, steps, order, goes) = servant();
        assert_eq!(submit(&steps, handle), palpate_status::Ok);
        let remover = std::thread::spawn(move || remove::<Told>(handle).unwrap());
        order.send(Order::Go).unwrap();
        remover.join().unwrap();
        goes.recv().unwrap();
        assert_eq!(submit(&steps, handle), palpate_status::Handle);
        assert_eq!(Arc::strong_count(&steps), 1);
        assert!(steps.worker.lock().unwrap().is_none() && is_done(&steps));
    }
}

#[test]
fn a_worker_that_is_the_last_to_hold_its_object_ends_by_itself() {
    let (handle, steps, order, goes) = servant();
    assert_eq!(submit(&steps, handle), palpate_status::Ok);
    drop(steps);
    handles::remove::<Told>(handle).unwrap();
    order.send(Order::Go).unwrap();
    goes.recv().unwrap();
}
