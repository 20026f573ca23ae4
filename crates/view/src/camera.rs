//! The camera of a rendered image: its pose, its projection of points to pixels, and the displacement in the world that
//! belongs to a movement of the mouse cursor. The *eye* is the camera's position, the *target* the point that it looks
//! at. World y is up; pixels are counted from the image's upper left corner.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat4, DVec2, DVec3, DVec4};

/// Distances of the near and the far clipping plane from the eye, as multiples of the eye's distance from the target.
const NEAR: f64 = 0.01;
const FAR: f64 = 100.0;
/// Vertical field of view, rad.
const FOVY: f64 = 40.0 * PI / 180.0;
/// Factor by which the view is larger than the sphere around the box that it is to show.
const ROOM: f64 = 1.15;
/// Greatest angle of the eye above and below the horizon, rad: a little short of vertical, so that the image is never
/// upside down.
const STEEPEST: f64 = FRAC_PI_2 - 0.01;
/// Least and greatest distance of the eye from the target, m.
const NEAREST: f64 = 1e-4;
const FARTHEST: f64 = 1e4;

/// An eye that looks at a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// The point that the eye looks at, m.
    pub target: DVec3,
    /// Distance of the eye from the target, m.
    pub distance: f64,
    /// Angle about the world's y axis, rad; at 0 the eye looks from +z towards -z.
    pub yaw: f64,
    /// Angle of the eye above the horizon, rad.
    pub pitch: f64,
    /// Vertical field of view, rad.
    pub fovy: f64,
}

/// The camera's axes in the world, unit vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// Axis towards the image's right.
    pub right: DVec3,
    /// Axis towards the image's top.
    pub up: DVec3,
    /// Axis into the image, from the eye to the target.
    pub forward: DVec3,
}

/// A half-line from the eye through a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Position of the eye, m.
    pub origin: DVec3,
    /// Unit vector away from the eye.
    pub direction: DVec3,
}

impl Camera {
    /// A camera that looks from the front, a little from the right and from above, at the box between these corners,
    /// from so far away that the box fits into the view.
    pub fn around(low: DVec3, high: DVec3) -> Camera {
        let radius = 0.5 * low.distance(high);
        let sound = radius.is_finite() && radius > 0.0;
        let (target, radius) = if sound { (0.5 * (low + high), radius) } else { (DVec3::ZERO, 0.1) };
        let distance = (ROOM * radius / (0.5 * FOVY).sin()).clamp(NEAREST, FARTHEST);
        Camera { target, distance, yaw: 0.5, pitch: 0.3, fovy: FOVY }
    }

    /// Position of the eye, m.
    pub fn eye(&self) -> DVec3 {
        self.target - self.distance * self.axes().forward
    }

    /// The camera's axes.
    pub fn axes(&self) -> Axes {
        let ((sy, cy), (sp, cp)) = (self.yaw.sin_cos(), self.pitch.sin_cos());
        Axes {
            right: DVec3::new(cy, 0.0, -sy),
            up: DVec3::new(-sy * sp, cp, -cy * sp),
            forward: -DVec3::new(sy * cp, sp, cy * cp),
        }
    }

    /// Distances of the near and the far clipping plane from the eye along [`Axes::forward`], m.
    pub fn planes(&self) -> [f64; 2] {
        [NEAR * self.distance, FAR * self.distance]
    }

    /// The view matrix, from the world to the camera's axes: right, up, and backwards from target to eye.
    pub fn view(&self) -> DMat4 {
        let (Axes { right, up, forward }, eye) = (self.axes(), self.eye());
        let row = |axis: DVec3| axis.extend(-axis.dot(eye));
        DMat4::from_cols(row(right), row(up), row(-forward), DVec4::W).transpose()
    }

    /// The matrix from the world to Vulkan's clip space for an image of this size: y down, depth from 0 at the near
    /// plane to 1 at the far one.
    pub fn matrix(&self, width: u32, height: u32) -> DMat4 {
        let ([near, far], scale) = (self.planes(), 1.0 / (0.5 * self.fovy).tan());
        let aspect = f64::from(width.max(1)) / f64::from(height.max(1));
        let depth = far / (near - far);
        let projection = DMat4::from_cols(
            DVec4::new(scale / aspect, 0.0, 0.0, 0.0),
            DVec4::new(0.0, -scale, 0.0, 0.0),
            DVec4::new(0.0, 0.0, depth, -1.0),
            DVec4::new(0.0, 0.0, near * depth, 0.0),
        );
        projection * self.view()
    }

    /// The pixel that shows a point in an image of this size; `None` if the point is behind the eye.
    pub fn project(&self, point: DVec3, width: u32, height: u32) -> Option<DVec2> {
        let clip = self.matrix(width, height) * point.extend(1.0);
        let size = DVec2::new(width.into(), height.into());
        (clip.w > 0.0).then(|| 0.5 * (DVec2::new(clip.x, clip.y) / clip.w + 1.0) * size)
    }

    /// The ray from the eye through the pixel (`x`, `y`) of an image of this size.
    pub fn ray(&self, x: f64, y: f64, width: u32, height: u32) -> Ray {
        let (Axes { right, up, forward }, pixel) = (self.axes(), self.pixel(1.0, height));
        let [across, down] = [x - 0.5 * f64::from(width), y - 0.5 * f64::from(height)].map(|d| pixel * d);
        Ray { origin: self.eye(), direction: (forward + across * right - down * up).normalize() }
    }

    /// World displacement, m, of a point that is dragged parallel to the image by a cursor's movement of (`dx`, `dy`)
    /// pixels, in an image of this height, pixels.
    pub fn drag(&self, point: DVec3, dx: f64, dy: f64, height: u32) -> DVec3 {
        let Axes { right, up, forward } = self.axes();
        let pixel = self.pixel(forward.dot(point - self.eye()).max(self.planes()[0]), height);
        pixel * (dx * right - dy * up)
    }

    /// Turns the camera about its target by these angles, rad.
    pub fn orbit(&mut self, yaw: f64, pitch: f64) {
        self.yaw = (self.yaw + yaw).rem_euclid(2.0 * PI);
        self.pitch = (self.pitch + pitch).clamp(-STEEPEST, STEEPEST);
    }

    /// Moves the camera parallel to the image, so that the point at the target follows a cursor's movement of (`dx`,
    /// `dy`) pixels.
    pub fn pan(&mut self, dx: f64, dy: f64, height: u32) {
        self.target -= self.drag(self.target, dx, dy, height);
    }

    /// Multiplies the eye's distance from the target by a factor; the point at the target's depth that the pixel (`x`,
    /// `y`) shows stays at that pixel.
    pub fn zoom(&mut self, factor: f64, x: f64, y: f64, width: u32, height: u32) {
        let distance = (factor * self.distance).clamp(NEAREST, FARTHEST);
        let (dx, dy) = (x - 0.5 * f64::from(width), y - 0.5 * f64::from(height));
        let under = self.drag(self.target, dx, dy, height);
        self.target += (1.0 - distance / self.distance) * under;
        self.distance = distance;
    }

    /// Width, m, that a pixel covers at `depth`, the distance (m) from the eye along [`Axes::forward`].
    fn pixel(&self, depth: f64, height: u32) -> f64 {
        2.0 * depth * (0.5 * self.fovy).tan() / f64::from(height.max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (640, 360);

    fn cameras() -> Vec<Camera> {
        let first = Camera::around(DVec3::new(-0.1, 0.0, -0.2), DVec3::new(0.3, 0.2, 0.1));
        let turned = |yaw, pitch| {
            let mut camera = first;
            camera.orbit(yaw, pitch);
            camera
        };
        vec![first, turned(1.0, 0.4), turned(-2.0, -1.5), turned(3.0, 9.0)]
    }

    #[test]
    fn axes_are_orthonormal_and_right_handed_and_up_is_never_down() {
        for camera in cameras() {
            let Axes { right, up, forward } = camera.axes();
            assert!((right.cross(up) + forward).length() < 1e-14);
            assert!((right.length() - 1.0).abs() < 1e-14 && up.y > 0.0);
            assert!((camera.eye().distance(camera.target) - camera.distance).abs() < 1e-12);
        }
        let front = Camera { yaw: 0.0, pitch: 0.0, ..cameras()[0] };
        assert_eq!(front.axes(), Axes { right: DVec3::X, up: DVec3::Y, forward: -DVec3::Z });
    }

    #[test]
    fn clip_space_is_vulkans() {
        for camera in cameras() {
            let (Axes { right, up, forward }, [near, far]) = (camera.axes(), camera.planes());
            let clip = |point: DVec3| (camera.matrix(SIZE.0, SIZE.1) * point.extend(1.0)) / 1.0;
            let place = |point: DVec3| clip(point).truncate() / clip(point).w;
            let (eye, target) = (camera.eye(), camera.target);
            assert!(place(target).truncate().length() < 1e-12);
            assert!(place(eye + near * forward).z.abs() < 1e-9);
            assert!((place(eye + far * forward).z - 1.0).abs() < 1e-9);
            let half = camera.distance * (0.5 * camera.fovy).tan();
            assert!((place(target + half * up).y + 1.0).abs() < 1e-9, "y must point down in clip space");
            assert!((place(target + half * right).x - 360.0 / 640.0).abs() < 1e-9);
            assert_eq!(camera.project(eye - forward, SIZE.0, SIZE.1), None);
        }
    }

    #[test]
    fn a_pixel_shows_what_its_ray_meets() {
        for camera in cameras() {
            for (x, y) in [(0.0, 0.0), (320.0, 180.0), (17.25, 301.5), (640.0, 360.0)] {
                let ray = camera.ray(x, y, SIZE.0, SIZE.1);
                for depth in [0.1, 1.0, 30.0] {
                    let point = ray.origin + depth * camera.distance * ray.direction;
                    let pixel = camera.project(point, SIZE.0, SIZE.1).unwrap();
                    assert!((pixel - DVec2::new(x, y)).length() < 1e-7, "the point is at {pixel}, not at ({x}, {y})");
                }
            }
        }
    }

    #[test]
    fn what_is_dragged_stays_under_the_cursor() {
        for camera in cameras() {
            let point = camera.target + DVec3::new(0.03, -0.02, 0.05);
            let before = camera.project(point, SIZE.0, SIZE.1).unwrap();
            let moved = point + camera.drag(point, 31.0, -12.5, SIZE.1);
            let after = camera.project(moved, SIZE.0, SIZE.1).unwrap();
            assert!((after - before - DVec2::new(31.0, -12.5)).length() < 1e-9);
            assert!(camera.axes().forward.dot(moved - point).abs() < 1e-12);
        }
    }

    #[test]
    fn panning_and_zooming_keep_what_is_under_the_cursor() {
        for camera in cameras() {
            let mut panned = camera;
            panned.pan(40.0, 25.0, SIZE.1);
            let moved = panned.project(camera.target, SIZE.0, SIZE.1).unwrap();
            assert!((moved - DVec2::new(360.0, 205.0)).length() < 1e-9);
            let (x, y) = (500.0, 90.0);
            let point = camera.target + camera.drag(camera.target, x - 320.0, y - 180.0, SIZE.1);
            for factor in [0.5, 1.0, 2.0, 1e-9, 1e9] {
                let mut zoomed = camera;
                zoomed.zoom(factor, x, y, SIZE.0, SIZE.1);
                let pixel = zoomed.project(point, SIZE.0, SIZE.1).unwrap();
                assert!((pixel - DVec2::new(x, y)).length() < 1e-6, "zoom by {factor}: the point moved to {pixel}");
                assert!((NEAREST..=FARTHEST).contains(&zoomed.distance));
            }
        }
    }

    #[test]
    fn a_box_is_framed_whole() {
        let (low, high) = (DVec3::new(-1.0, -2.0, 0.5), DVec3::new(3.0, 1.0, 2.0));
        let mut camera = Camera::around(low, high);
        for turn in 0..12 {
            camera.orbit(0.7, if turn % 2 == 0 { 0.5 } else { -0.6 });
            for corner in 0..8 {
                let pick = |k: usize| if corner >> k & 1 == 0 { low[k] } else { high[k] };
                let pixel = camera.project(DVec3::new(pick(0), pick(1), pick(2)), SIZE.0, SIZE.1).unwrap();
                let inside = |x: f64, size: u32| (0.0..=f64::from(size)).contains(&x);
                assert!(inside(pixel.x, SIZE.0) && inside(pixel.y, SIZE.1), "a corner is outside, at pixel {pixel}");
            }
        }
        for corner in [DVec3::ZERO, DVec3::INFINITY, DVec3::NAN] {
            let camera = Camera::around(corner, corner);
            assert!(camera.matrix(640, 0).is_finite(), "the matrix must be finite for a box without extent");
        }
    }
}
