//! The files of a series: for each soft body its layer (tetrahedral mesh) and its skin (surface mesh), for each rigid
//! one its skin, and the contacts.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::{Body, Embedding, Layer, Shape};
use palpate::scene::vtk_xml::write::{Array, Cells, Data, Encoder, Numbers, write_series};
use palpate::{ContactPoint, Result, Simulation};

use super::fields::{eigenvalues, least_stretch};
use super::moment::{Moment, State};
use crate::report::Output;

/// Types of cells in VTK files.
const POINT: u8 = 1;
const TRIANGLE: u8 = 5;
const TETRAHEDRON: u8 = 10;

/// The files of each series by its name, with their times (s).
pub type Series = BTreeMap<String, Vec<(f64, String)>>;

/// Writes the files of a series.
pub struct Files {
    output: Output,
    encoder: Encoder,
    bodies: Vec<Shown>,
    series: Series,
}

/// A body of which files are written.
struct Shown {
    name: String,
    triangles: Cells,
    soft: Option<Soft>,
    /// Where the vertices of a rigid body were in its last file.
    last: Vec<DVec3>,
}

/// What stays of a soft body while it deforms.
struct Soft {
    layer: Layer,
    embedding: Vec<Embedding>,
    /// Vertices of the skin at rest, own axes, m.
    rest: Vec<DVec3>,
    position: DVec3,
    orientation: DQuat,
    tetrahedra: Cells,
    /// Inverse of the matrix of the edges of each tetrahedron at rest.
    inverse_edges: Vec<DMat3>,
    materials: Array,
}

impl Files {
    /// Prepares files of the bodies of a simulation, compressed at a level from 0 to 9.
    pub fn new(simulation: &Simulation, output: Output, level: u8) -> Files {
        let encoder = Encoder { level };
        let names = simulation.bodies().iter().map(|body| body.name.clone()).chain(["tool".into()]);
        let shown = |(index, name): (usize, String)| Shown {
            name,
            triangles: encoder.cells(TRIANGLE, simulation.skin_triangles(index)),
            soft: simulation.bodies().get(index).and_then(|body| Soft::new(encoder, body)),
            last: Vec::new(),
        };
        Files { output, encoder, bodies: names.enumerate().map(shown).collect(), series: Series::new() }
    }

    /// Writes the files of a moment. That of a rigid body is left out while the body stays; the list of files names the
    /// last one again.
    pub fn write(&mut self, moment: Moment) -> Result<()> {
        let Moment { steps, time, bodies, tetrahedra, contacts, forces } = moment;
        let mut shown = std::mem::take(&mut self.bodies);
        let mut first = 0;
        for (index, (body, state)) in shown.iter_mut().zip(bodies).enumerate() {
            let skin = format!("{}-skin", body.name);
            match (state, &body.soft, &tetrahedra) {
                (State::Soft { displacement, velocity }, Some(soft), Some(tetrahedra)) => {
                    let mut contact_force = vec![DVec3::ZERO; soft.rest.len()];
                    for own in forces.iter().filter(|force| force.body == index) {
                        contact_force[own.vertex] += own.force;
                    }
                    let range = first..first + soft.layer.tetrahedra.len();
                    first = range.end;
                    let moved: Vec<DVec3> = displacement.iter().map(|d| soft.orientation * *d).collect();
                    let (points, data) = soft.skin(self.encoder, &moved, &contact_force);
                    self.grid(&skin, steps, time, &points, &body.triangles, &data)?;
                    let (densities, stresses) = (&tetrahedra.densities[range.clone()], &tetrahedra.stresses[range]);
                    let (points, mut data) = soft.layer(self.encoder, &moved, densities, stresses);
                    let on_nodes = soft.spread(&contact_force);
                    data.points.push(vectors(self.encoder, "velocity", &velocity));
                    data.points.push(vectors(self.encoder, "contact_force", &on_nodes));
                    self.grid(&format!("{}-layer", body.name), steps, time, &points, &soft.tetrahedra, &data)?;
                }
                (State::Rigid { vertices }, ..) if !vertices.is_empty() => {
                    if vertices == body.last {
                        let files = self.series.entry(skin).or_default();
                        let again = files.last().map(|(_, file)| (time, file.clone()));
                        files.extend(again);
                    } else {
                        self.grid(&skin, steps, time, &coordinates(&vertices), &body.triangles, &Data::default())?;
                        body.last = vertices;
                    }
                }
                _ => {}
            }
        }
        self.bodies = shown;
        let (points, cells, data) = contact_grid(self.encoder, &contacts);
        self.grid("contacts", steps, time, &points, &cells, &data)
    }

    /// Writes the lists of files.
    pub fn end(mut self) -> Result<(Output, Series)> {
        for (name, files) in &self.series {
            self.output.write(&format!("{name}.pvd"), |w| write_series(w, files))?;
        }
        Ok((self.output, self.series))
    }

    fn grid(&mut self, series: &str, steps: u64, time: f64, points: &[f64], cells: &Cells, data: &Data) -> Result<()> {
        let file = format!("{series}-{steps:06}.vtu");
        self.output.write(&file, |w| self.encoder.write(w, time, points, cells, data))?;
        self.series.entry(series.into()).or_default().push((time, file));
        Ok(())
    }
}

impl Soft {
    fn new(encoder: Encoder, body: &Body) -> Option<Soft> {
        let Shape::Soft { layer, embedding, skin, materials, .. } = &body.shape else { return None };
        let inverse_edges = layer.tetrahedra.iter().map(|nodes| {
            let [a, b, c, d] = nodes.map(|n| layer.nodes[n as usize]);
            DMat3::from_cols(b - a, c - a, d - a).inverse()
        });
        let material: Vec<i32> = (0..layer.tetrahedra.len()).map(|t| materials.index(t) as i32).collect();
        Some(Soft {
            embedding: embedding.clone(),
            rest: skin.vertices.clone(),
            position: body.position,
            orientation: body.orientation,
            tetrahedra: encoder.cells(TETRAHEDRON, &layer.tetrahedra),
            inverse_edges: inverse_edges.collect(),
            materials: encoder.array("material", 1, &Numbers::I32(&material)),
            layer: layer.clone(),
        })
    }

    /// Points and data of the skin. `moved`: displacements of the nodes, world axes, m; `forces` on the vertices, N.
    fn skin(&self, encoder: Encoder, moved: &[DVec3], forces: &[DVec3]) -> (Vec<f64>, Data) {
        let displaced = |e: &Embedding| e.interpolate(&self.layer.tetrahedra, moved);
        let displacements: Vec<DVec3> = self.embedding.iter().map(displaced).collect();
        let points = self.placed(&self.rest, &displacements);
        let arrays = [("displacement", displacements.as_slice()), ("contact_force", forces)];
        let points_data = arrays.map(|(name, all)| vectors(encoder, name, all)).to_vec();
        (coordinates(&points), Data { points: points_data, cells: Vec::new() })
    }

    /// Points and data of the layer.
    fn layer(
        &self,
        encoder: Encoder,
        moved: &[DVec3],
        densities: &[[f32; 4]],
        stresses: &[[f32; 8]],
    ) -> (Vec<f64>, Data) {
        let points = self.placed(&self.layer.nodes, moved);
        let tensors: Vec<[f32; 6]> =
            stresses.iter().map(|[xx, yy, zz, _, xy, xz, yz, _]| [*xx, *yy, *zz, *xy, *yz, *xz]).collect();
        let principal = |tensor: &[f32; 6]| eigenvalues(tensor.map(f64::from)).map(|x| x as f32);
        let principal: Vec<[f32; 3]> = tensors.iter().map(principal).collect();
        let pressure = |[xx, yy, zz, ..]: &[f32; 6]| -(xx + yy + zz) / 3.0;
        let stretch = |(nodes, rest): (&[u32; 4], &DMat3)| {
            least_stretch(*rest * DMat3::from_quat(self.orientation.conjugate()), nodes.map(|n| points[n as usize]))
                as f32
        };
        let scalars = |name: &str, all: Vec<f32>| encoder.array(name, 1, &Numbers::F32(&all));
        let cells = vec![
            encoder.array("cauchy_stress", 6, &Numbers::F32(tensors.as_flattened())),
            encoder.array("principal_stress", 3, &Numbers::F32(principal.as_flattened())),
            scalars("von_mises_stress", stresses.iter().map(|row| row[3]).collect()),
            scalars("hydrostatic_pressure", tensors.iter().map(pressure).collect()),
            scalars("strain_energy_density", densities.iter().map(|row| row[0]).collect()),
            scalars("least_stretch", self.layer.tetrahedra.iter().zip(&self.inverse_edges).map(stretch).collect()),
            self.materials.clone(),
        ];
        (coordinates(&points), Data { points: vec![vectors(encoder, "displacement", moved)], cells })
    }

    /// World positions of points that are displaced (world axes, m) from where they are at rest.
    fn placed(&self, rest: &[DVec3], displacements: &[DVec3]) -> Vec<DVec3> {
        let now = |(rest, d): (&DVec3, &DVec3)| self.position + self.orientation * *rest + *d;
        rest.iter().zip(displacements).map(now).collect()
    }

    /// Forces on the nodes, from those on the vertices of the skin by the weights of their embedding.
    fn spread(&self, forces: &[DVec3]) -> Vec<DVec3> {
        let mut all = vec![DVec3::ZERO; self.layer.nodes.len()];
        for (force, e) in forces.iter().zip(&self.embedding).filter(|(force, _)| **force != DVec3::ZERO) {
            let nodes = self.layer.tetrahedra[e.tetrahedron as usize];
            nodes.iter().zip(e.weights).for_each(|(n, w)| all[*n as usize] += w * *force);
        }
        all
    }
}

/// The contacts as points.
fn contact_grid(encoder: Encoder, contacts: &[ContactPoint]) -> (Vec<f64>, Cells, Data) {
    let positions: Vec<DVec3> = contacts.iter().map(|contact| contact.position).collect();
    let vertices: Vec<[u32; 1]> = (0..contacts.len() as u32).map(|k| [k]).collect();
    let vector = |name: &str, of: &dyn Fn(&ContactPoint) -> DVec3| {
        vectors(encoder, name, &contacts.iter().map(of).collect::<Vec<_>>())
    };
    let scalar = |name: &str, of: &dyn Fn(&ContactPoint) -> f64| {
        let all: Vec<f32> = contacts.iter().map(|contact| of(contact) as f32).collect();
        encoder.array(name, 1, &Numbers::F32(&all))
    };
    let index = |name: &str, of: &dyn Fn(&ContactPoint) -> usize| {
        let all: Vec<i32> = contacts.iter().map(|contact| of(contact) as i32).collect();
        encoder.array(name, 1, &Numbers::I32(&all))
    };
    let points = vec![
        vector("normal", &|contact| contact.normal),
        scalar("depth", &|contact| contact.depth),
        scalar("area", &|contact| contact.area),
        scalar("pressure", &|contact| contact.pressure),
        vector("force", &ContactPoint::force),
        index("body", &|contact| contact.bodies[0]),
        index("other_body", &|contact| contact.bodies[1]),
        index("vertex", &|contact| contact.vertex),
    ];
    (coordinates(&positions), encoder.cells(POINT, &vertices), Data { points, cells: Vec::new() })
}

fn coordinates(points: &[DVec3]) -> Vec<f64> {
    points.iter().flat_map(|x| x.to_array()).collect()
}

fn vectors(encoder: Encoder, name: &str, all: &[DVec3]) -> Array {
    let numbers: Vec<f32> = all.iter().flat_map(|v| v.as_vec3().to_array()).collect();
    encoder.array(name, 3, &Numbers::F32(&numbers))
}
