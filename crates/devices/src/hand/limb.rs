//! One step of the simulated hand (a person's hand that holds a haptic device) in translation or in rotation: a mass on
//! a spring and a damper, with friction. The implicit midpoint rule is stable at any stiffness and keeps an exact
//! energy balance: work, loss and change of the stored energy add up, to rounding. Coulomb friction acts afterwards as
//! an impulse that slows the mass and never reverses its motion.

use glam::DVec3;
use palpate::scene::HandParameters;

/// Constants of the arm or of the wrist. Units are given for the arm, in translation; for the wrist, in rotation, they
/// are kg m^2, N m/rad, N m s/rad and N m.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limb {
    /// Mass, kg.
    pub(super) mass: f64,
    /// Stiffness of the spring towards the position that the person intends, N/m.
    pub(super) stiffness: f64,
    /// Damping towards the intended velocity, N s/m.
    pub(super) damping: f64,
    /// The device's own damping, towards rest, N s/m.
    pub(super) drag: f64,
    /// Coulomb friction of the device, N, the same in all directions.
    pub(super) friction: f64,
}

impl Limb {
    /// The arm, for translation.
    pub(super) fn arm(hand: &HandParameters) -> Limb {
        Limb {
            mass: hand.mass,
            stiffness: hand.stiffness,
            damping: hand.damping,
            drag: hand.device_damping,
            friction: hand.friction,
        }
    }

    /// The wrist, for rotation.
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

/// What acts on a limb (arm or wrist) during a step; units are those of the arm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Load {
    /// Actual minus intended position at the start, m.
    pub(super) stretch: DVec3,
    /// Mean intended velocity, m/s.
    pub(super) intended: DVec3,
    /// Force that the device plays, that is exerts on the hand, N.
    pub(super) force: DVec3,
}

/// Result of a step; units are those of the arm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stride {
    /// Mean velocity over the step, m/s; times the step's length it is the displacement.
    pub(super) mean: DVec3,
    /// Velocity at the end, m/s.
    pub(super) velocity: DVec3,
    /// Work of the played force, J.
    pub(super) played: f64,
    /// Work that the person does by moving the intended position, J.
    pub(super) intent: f64,
    /// Energy dissipated by dampers and friction, J; never negative.
    pub(super) lost: f64,
}

impl Limb {
    /// Does a step of `h` seconds that begins at `velocity` (m/s).
    pub(super) fn step(&self, h: f64, velocity: DVec3, load: &Load) -> Stride {
        let Load { stretch, intended, force } = *load;
        // The equation of motion at the midpoint is inertia * (mean - velocity) + resistance * mean = push.
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

    /// Energy of the motion at `velocity` and of the spring stretched by `stretch`, J.
    pub(super) fn stored(&self, stretch: DVec3, velocity: DVec3) -> f64 {
        0.5 * (self.mass * velocity.length_squared() + self.stiffness * stretch.length_squared())
    }
}

/// A velocity whose magnitude is reduced by `by`, at most to zero.
fn slowed(velocity: DVec3, by: f64) -> DVec3 {
    let speed = velocity.length();
    if speed > by { velocity * (1.0 - by / speed) } else { DVec3::ZERO }
}
