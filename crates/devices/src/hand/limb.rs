//! A mass on a spring and a damper, with friction: one step of the simulated hand, in translation or rotation. The implicit
//! midpoint rule is stable at any stiffness, and what it does to the energy is exact: work, loss and change of the stored
//! energy balance to rounding. Coulomb friction acts after it as an impulse that slows and never reverses.

use glam::DVec3;
use palpate::scene::HandParameters;

/// Constants; in rotation read kg m^2, N m/rad, N m s/rad and N m.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limb {
    /// kg.
    pub(super) mass: f64,
    /// Of the spring towards where the person intends to be, N/m.
    pub(super) stiffness: f64,
    /// Of the damper towards the intended velocity, N s/m.
    pub(super) damping: f64,
    /// Towards rest: the device's, N s/m.
    pub(super) drag: f64,
    /// Coulomb friction of the device, N, the same in all directions.
    pub(super) friction: f64,
}

impl Limb {
    /// Of translation.
    pub(super) fn arm(hand: &HandParameters) -> Limb {
        Limb {
            mass: hand.mass,
            stiffness: hand.stiffness,
            damping: hand.damping,
            drag: hand.device_damping,
            friction: hand.friction,
        }
    }

    /// Of rotation.
    pub(super) fn wrist(hand: &HandParameters) -> Limb {
        Limb {
            mass: hand.inertia,
            stiffness: hand.angular_stiffness,
            damping: hand.angular_damping,
            drag: 0.0,
            friction: 0.0,
        }
    }
}

/// What acts on a limb during a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Load {
    /// Actual less intended position at the start, m.
    pub(super) stretch: DVec3,
    /// Mean intended velocity, m/s.
    pub(super) intended: DVec3,
    /// Force played, N.
    pub(super) force: DVec3,
}

/// What a step does.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stride {
    /// Mean velocity, m/s: the step's length times this is the way.
    pub(super) mean: DVec3,
    /// Velocity at the end, m/s.
    pub(super) velocity: DVec3,
    /// Work of the played force, J.
    pub(super) played: f64,
    /// Work of the person, who moves the intended position, J.
    pub(super) intent: f64,
    /// Taken by dampers and friction, J; never negative.
    pub(super) lost: f64,
}

impl Limb {
    /// A step of `h` seconds from a velocity, m/s.
    pub(super) fn step(&self, h: f64, velocity: DVec3, load: &Load) -> Stride {
        let Load { stretch, intended, force } = *load;
        // The equation of motion at the midpoint is inertia x (mean - velocity) + resistance x mean = push.
        let inertia = 2.0 * self.mass / h;
        let resistance = 0.5 * h * self.stiffness + self.damping + self.drag;
        let push = force - self.stiffness * (stretch - 0.5 * h * intended) + self.damping * intended;
        let sticks = velocity == DVec3::ZERO && push.length() <= self.friction;
        let mean = if sticks { DVec3::ZERO } else { (inertia * velocity + push) / (inertia + resistance) };
        let free = 2.0 * mean - velocity;
        let end = slowed(free, h * self.friction / self.mass);
        let slip = mean - intended;
        let arm = -self.stiffness * (stretch + 0.5 * h * slip) - self.damping * slip;
        let damped = h * (self.damping * slip.length_squared() + self.drag * mean.length_squared());
        let rubbed = 0.5 * self.mass * (free.length_squared() - end.length_squared());
        Stride {
            mean,
            velocity: end,
            played: h * force.dot(mean),
            intent: h * arm.dot(intended),
            lost: damped + rubbed,
        }
    }

    /// Energy of motion and of the spring, J.
    pub(super) fn stored(&self, stretch: DVec3, velocity: DVec3) -> f64 {
        0.5 * (self.mass * velocity.length_squared() + self.stiffness * stretch.length_squared())
    }
}

/// A velocity shortened by `by`, at most to rest.
fn slowed(velocity: DVec3, by: f64) -> DVec3 {
    let speed = velocity.length();
    if speed > by { velocity * (1.0 - by / speed) } else { DVec3::ZERO }
}
