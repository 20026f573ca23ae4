//! A session as a log in the format MCAP, which Foxglove, rerun and readers in many languages open. Every message is
//! encoded as protobuf, and the file holds the schemas: the poses, contacts and flags are those of Foxglove, which
//! viewers know how to draw; ticks (iterations of the haptic loop) and steps have schemas made of their own
//! [`fields`](super::fields).

use std::collections::BTreeMap;
use std::io::{Error, Result, Seek, Write};

use foxglove::Encode;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{self, PackedElementField, PointCloud, Pose, PoseInFrame, Quaternion, Timestamp, Vector3};
use mcap::McapError;
use mcap::records::{MessageHeader, Metadata};
use palpate::internal::haptics::servo::Tick;
use palpate::{ContactPoint, Flags, RigidState};
use prost_reflect::prost::Message;
use prost_reflect::prost_types::field_descriptor_proto::{Label, Type};
use prost_reflect::prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet};
use prost_reflect::{DescriptorPool, DynamicMessage, MessageDescriptor};

use super::fields::{self, Field, Value};
use super::{Begin, Header, Leader, Step};

/// Messages are written out in chunks of at least this many bytes; a program that is killed loses its last chunk.
const CHUNK: u64 = 1 << 16;
/// The frame of all positions.
const WORLD: &str = "world";
/// What a contact is in the log: the names of its numbers, each of eight bytes, then those of its indices of four.
const NUMBERS: [&str; 13] = [
    "x", "y", "z", "normal_x", "normal_y", "normal_z", "force_x", "force_y", "force_z", "force", "depth", "area",
    "pressure",
];
const INDICES: [&str; 3] = ["body", "vertex", "touched_body"];

/// Results of a step beside the wrench on the tool.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The contacts at the end of the step.
    pub contacts: Vec<ContactPoint>,
    /// What went wrong in the step.
    pub flags: Flags,
}

/// A log being written. If it is dropped before [`Log::finish`], it is finished all the same.
pub struct Log<W: Write + Seek> {
    writer: mcap::Writer<W>,
    leaders: Vec<LeaderChannels>,
    contacts: Channel,
    flags: Channel,
}

/// The channels of one haptic device and its tool. Their topics begin with `prefix`: nothing for the first, the tool's
/// name for any other.
struct LeaderChannels {
    prefix: String,
    ticks: Option<Rows>,
    steps: Option<Rows>,
    device: Channel,
    tool: Channel,
}

struct Channel {
    id: u16,
    sequence: u32,
}

/// A channel whose messages are lists of fields.
struct Rows {
    channel: Channel,
    message: MessageDescriptor,
}

impl<W: Write + Seek> Log<W> {
    /// A log of the session that `header` describes.
    pub fn new(writer: W, header: &Header) -> Result<Log<W>> {
        let options = mcap::WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK))
            .library(format!("palpate {}", header.program));
        let mut writer = options.create(writer).map_err(failed)?;
        let mut leaders = Vec::new();
        for (index, leader) in header.leaders.iter().enumerate() {
            let prefix = if index == 0 { String::new() } else { format!("/{}", leader.tool) };
            let device = add::<PoseInFrame, W>(&mut writer, &format!("{prefix}/device"))?;
            let tool = add::<PoseInFrame, W>(&mut writer, &format!("{prefix}/tool"))?;
            leaders.push(LeaderChannels { prefix, ticks: None, steps: None, device, tool });
        }
        let contacts = add::<PointCloud, W>(&mut writer, "/contacts")?;
        let flags = add::<messages::Log, W>(&mut writer, "/flags")?;
        let mut log = Log { writer, leaders, contacts, flags };
        let Header { program, scene, scene_digest, device, driver, depth, leaders } = header;
        let all = |of: fn(&Leader) -> &str| leaders.iter().map(of).collect::<Vec<_>>().join(" ");
        let digest: String = scene_digest.iter().map(|byte| format!("{byte:02x}")).collect();
        log.describe(
            "session",
            [
                ("program", program),
                ("scene", scene),
                ("scene_sha256", &digest),
                ("device", device),
                ("driver", driver),
                ("depth", depth.as_deref().unwrap_or_default()),
                ("tool", &all(|leader| &leader.tool)),
                ("profile", &all(|leader| &leader.profile)),
                ("haptic_device", &all(|leader| &leader.device)),
            ],
        )?;
        Ok(log)
    }

    /// Writes what the haptic loop of the tool `index` was made with.
    pub fn begin(&mut self, index: usize, begin: &Begin) -> Result<()> {
        let settings = serde_json::to_string(&begin.settings)?;
        let tool = serde_json::to_string(&begin.tool)?;
        let name = format!("loop{}", self.leaders[index].prefix);
        self.describe(&name, [("settings", &settings), ("tool", &tool)])
    }

    /// Writes a tick of the tool `index`: its fields, and the poses of device and tool.
    pub fn tick(&mut self, index: usize, tick: &Tick) -> Result<()> {
        let at = nanoseconds(tick.time);
        let LeaderChannels { prefix, ticks, device, tool, .. } = &mut self.leaders[index];
        put_row(&mut self.writer, ticks, prefix, "Tick", at, &fields::of_tick(tick))?;
        put(&mut self.writer, device, at, &pose(at, &tick.device))?;
        put(&mut self.writer, tool, at, &pose(at, &tick.tool))
    }

    /// Writes a step, at the time at which its inputs were taken.
    pub fn step(&mut self, step: &Step) -> Result<()> {
        for (leader, (input, wrench)) in self.leaders.iter_mut().zip(step.inputs.iter().zip(&step.wrenches)) {
            let fields = fields::of_step(input, step.h, wrench);
            put_row(&mut self.writer, &mut leader.steps, &leader.prefix, "Step", nanoseconds(input.time), &fields)?;
        }
        Ok(())
    }

    /// Writes the outcome of a step whose inputs were taken at `time`, s.
    pub fn outcome(&mut self, time: f64, outcome: &Outcome) -> Result<()> {
        let at = nanoseconds(time);
        put(&mut self.writer, &mut self.contacts, at, &cloud(at, &outcome.contacts))?;
        if outcome.flags == Flags::default() {
            return Ok(());
        }
        let flags = messages::Log {
            timestamp: Some(timestamp(at)),
            level: messages::log::Level::Warning.into(),
            message: outcome.flags.names().collect::<Vec<_>>().join(" "),
            name: "palpate".into(),
            file: String::new(),
            line: 0,
        };
        put(&mut self.writer, &mut self.flags, at, &flags)
    }

    /// Writes the end of the log, with its index.
    pub fn finish(mut self) -> Result<()> {
        self.writer.finish().map_err(failed)?;
        self.writer.into_inner().flush()
    }

    /// Writes a record of names and values that describes the session.
    fn describe<const N: usize>(&mut self, name: &str, values: [(&str, &str); N]) -> Result<()> {
        let metadata = values.into_iter().map(|(name, value)| (name.into(), value.into())).collect();
        self.writer.write_metadata(&Metadata { name: name.into(), metadata }).map_err(failed)
    }
}

fn failed(error: McapError) -> Error {
    match error {
        McapError::Io(error) => error,
        other => Error::other(other),
    }
}

/// Adds a channel of messages of a type of Foxglove.
fn add<M: Encode, W: Write + Seek>(writer: &mut mcap::Writer<W>, topic: &str) -> Result<Channel> {
    let schema = M::get_schema().ok_or_else(|| Error::other("a message of Foxglove has no schema"))?;
    channel(writer, topic, &schema.name, &schema.data)
}

fn channel<W: Write + Seek>(writer: &mut mcap::Writer<W>, topic: &str, name: &str, schema: &[u8]) -> Result<Channel> {
    let schema = writer.add_schema(name, "protobuf", schema).map_err(failed)?;
    let id = writer.add_channel(schema, topic, "protobuf", &BTreeMap::new()).map_err(failed)?;
    Ok(Channel { id, sequence: 0 })
}

/// Writes a message of a type of Foxglove.
fn put<M: Encode, W: Write + Seek>(
    writer: &mut mcap::Writer<W>,
    channel: &mut Channel,
    at: u64,
    message: &M,
) -> Result<()> {
    let mut bytes = Vec::new();
    message.encode(&mut bytes).map_err(|error| Error::other(error.to_string()))?;
    channel.write(writer, at, &bytes)
}

/// Writes fields as a message; the first message of a channel `rows` makes the channel, its topic with this prefix and its
/// schema of the type `name`.
fn put_row<W: Write + Seek>(
    writer: &mut mcap::Writer<W>,
    rows: &mut Option<Rows>,
    prefix: &str,
    name: &str,
    at: u64,
    fields: &[Field],
) -> Result<()> {
    let rows = match rows {
        Some(rows) => rows,
        none => none.insert(Rows::new(writer, prefix, name, fields)?),
    };
    let mut message = DynamicMessage::new(rows.message.clone());
    for (field, number) in fields.iter().zip(1..) {
        let value = match field.value {
            Value::Count(count) => count.map(prost_reflect::Value::U64),
            Value::Number(number) => number.map(prost_reflect::Value::F64),
            Value::Events(events) => {
                let names = events.names().map(|name| prost_reflect::Value::String(name.into()));
                Some(prost_reflect::Value::List(names.collect()))
            }
        };
        if let Some(value) = value {
            message.set_field_by_number(number, value);
        }
    }
    rows.channel.write(writer, at, &message.encode_to_vec())
}

impl Rows {
    fn new<W: Write + Seek>(writer: &mut mcap::Writer<W>, prefix: &str, name: &str, fields: &[Field]) -> Result<Rows> {
        let field = |(field, number): (&Field, i32)| {
            let (label, kind) = match field.value {
                Value::Count(_) => (Label::Optional, Type::Uint64),
                Value::Number(_) => (Label::Optional, Type::Double),
                Value::Events(_) => (Label::Repeated, Type::String),
            };
            FieldDescriptorProto {
                name: Some(field.name()),
                number: Some(number),
                label: Some(label.into()),
                r#type: Some(kind.into()),
                ..FieldDescriptorProto::default()
            }
        };
        let message = DescriptorProto {
            name: Some(name.into()),
            field: fields.iter().zip(1..).map(field).collect(),
            ..DescriptorProto::default()
        };
        // Without a syntax the file is of protobuf 2, where a number may be missing.
        let file = FileDescriptorProto {
            name: Some(format!("palpate/{name}.proto")),
            package: Some("palpate".into()),
            message_type: vec![message],
            ..FileDescriptorProto::default()
        };
        let set = FileDescriptorSet { file: vec![file] };
        let schema = set.encode_to_vec();
        let full = format!("palpate.{name}");
        let pool = DescriptorPool::from_file_descriptor_set(set).map_err(Error::other)?;
        let message = pool.get_message_by_name(&full).ok_or_else(|| Error::other("a schema lacks its message"))?;
        let topic = format!("{prefix}/{}", name.to_lowercase());
        Ok(Rows { channel: channel(writer, &topic, &full, &schema)?, message })
    }
}

impl Channel {
    fn write<W: Write + Seek>(&mut self, writer: &mut mcap::Writer<W>, at: u64, message: &[u8]) -> Result<()> {
        let header = MessageHeader { channel_id: self.id, sequence: self.sequence, log_time: at, publish_time: at };
        self.sequence = self.sequence.wrapping_add(1);
        writer.write_to_known_channel(&header, message).map_err(failed)
    }
}

/// Time since the loop began, ns. The loop's clock starts at zero; if it fails and goes below, the time is zero here, and
/// the field `time_s` has it.
fn nanoseconds(time: f64) -> u64 {
    (1e9 * time).round() as u64
}

fn timestamp(at: u64) -> Timestamp {
    const SECOND: u64 = 1_000_000_000;
    Timestamp::new_checked(u32::try_from(at / SECOND).unwrap_or(u32::MAX), (at % SECOND) as u32)
        .unwrap_or(Timestamp::MAX)
}

fn pose(at: u64, state: &RigidState) -> PoseInFrame {
    let [x, y, z] = state.position.to_array();
    let position = Some(Vector3 { x, y, z });
    let [x, y, z, w] = state.orientation.to_array();
    let orientation = Some(Quaternion { x, y, z, w });
    PoseInFrame { timestamp: Some(timestamp(at)), frame_id: WORLD.into(), pose: Some(Pose { position, orientation }) }
}

/// Contacts as points, whose numbers and indices are named by [`NUMBERS`] and [`INDICES`].
fn cloud(at: u64, contacts: &[ContactPoint]) -> PointCloud {
    let numbers = NUMBERS.iter().map(|name| (name, NumericType::Float64, 8));
    let indices = INDICES.iter().map(|name| (name, NumericType::Uint32, 4));
    let mut stride = 0;
    let mut fields = Vec::new();
    for (name, kind, bytes) in numbers.chain(indices) {
        fields.push(PackedElementField { name: name.to_string(), offset: stride, r#type: kind.into() });
        stride += bytes;
    }
    let mut data = Vec::new();
    for contact in contacts {
        let ContactPoint { bodies: [body, touched], vertex, position, normal, depth, area, pressure, .. } = *contact;
        let force = contact.force();
        let vectors = [position, normal, force].into_iter().flat_map(|vector| vector.to_array());
        let numbers = vectors.chain([force.length(), depth, area, pressure]);
        numbers.for_each(|number| data.extend(number.to_le_bytes()));
        [body, vertex, touched].iter().for_each(|index| data.extend((*index as u32).to_le_bytes()));
    }
    PointCloud {
        timestamp: Some(timestamp(at)),
        frame_id: WORLD.into(),
        pose: Some(Pose {
            position: Some(Vector3 { x: 0.0, y: 0.0, z: 0.0 }),
            orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        }),
        point_stride: stride,
        fields,
        data: data.into(),
    }
}
