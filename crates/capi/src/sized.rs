//! Functions that read and write memory of the C caller: structs, strings, arrays, and variables that receive results.
//! Structs may get further fields from one version of the library to the next, so a caller that was compiled with an
//! older or newer header has smaller or larger structs; therefore the caller writes the size of a struct into its first
//! field.

use std::ffi::{CStr, c_char};

use super::status::{Failure, Outcome, palpate_status};

/// A struct of the C interface whose first field is its size in bytes in the header that the caller was compiled with.
///
/// # Safety
/// The struct is `repr(C)`, its first field is a `u32` with the size, and any bytes are a valid value of it.
pub(super) unsafe trait Sized32: Copy {
    /// Name of the struct in the header.
    const NAME: &str;
    /// Size that the struct had in the first version of the header, bytes.
    const LEAST: usize;
    /// Places of all fields in the struct, in order; the macro [`fields!`] makes this list.
    const FIELDS: &'static [Field];
    /// Returns the struct with default values. When the struct of an older caller is read, the fields that the caller
    /// does not know keep these values.
    fn unset() -> Self;
}

/// Place of a field in its struct: offsets of its first byte (`start`) and of the byte after it (`end`), bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Field {
    pub start: usize,
    pub end: usize,
}

impl Field {
    /// Makes the place of a field that begins at offset `start`. The type `F` of the field, and so its size, is
    /// inferred from the second argument, a function that returns the field of a struct; this function is not called.
    pub const fn at<S, F>(start: usize, _: fn(&S) -> &F) -> Field {
        Field { start, end: start + size_of::<F>() }
    }
}

/// Makes the list [`Sized32::FIELDS`] of a struct from the names of its fields. The code does not compile if a field of
/// the struct is not named, or if the struct has no field of a given name.
macro_rules! fields {
    ($name:ident { $($field:ident),+ $(,)? }) => {{
        const _: fn(&$name) = |whole| {
            let $name { $($field: _),+ } = whole;
        };
        &[$($crate::sized::Field::at(std::mem::offset_of!($name, $field), |whole: &$name| &whole.$field)),+]
    }};
}
pub(super) use fields;

/// Returns whether a caller's struct may have this size, bytes, that is, whether the size cuts no field in two. Allowed
/// are the sizes that the struct can have in some version of the header: the end of a field; the end of the padding
/// after a field, which sizeof includes if that field was the last one in an earlier version; and every size from the
/// present one on, since later versions may add fields.
fn ends_whole<T: Sized32>(size: usize) -> bool {
    let starts = T::FIELDS.iter().skip(1).map(|field| field.start).chain([size_of::<T>()]);
    let padded =
        |field: &Field, next: usize| Some(field.end.next_multiple_of(align_of::<T>())).filter(|end| *end <= next);
    let is_end =
        T::FIELDS.iter().zip(starts).any(|(field, next)| size == field.end || padded(field, next) == Some(size));
    is_end || size >= size_of::<T>()
}

/// Reads a caller's struct of any version. If the pointer is null, the result has the default values.
///
/// # Safety
/// `from` is null, or leads to a struct of which as many bytes can be read as its first field states.
pub(super) unsafe fn read<T: Sized32>(from: *const T) -> Outcome<T> {
    let mut value = T::unset();
    if from.is_null() {
        return Ok(value);
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let size = unsafe { size_of_struct(from)? };
    let known = size.min(size_of::<T>());
    // SAFETY: the caller keeps the conditions under `# Safety`; any bytes are a valid `T`, and `value` has at least
    // `known` bytes.
    unsafe { std::ptr::copy_nonoverlapping(from.cast::<u8>(), (&raw mut value).cast::<u8>(), known) };
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let beyond = unsafe { std::slice::from_raw_parts(from.cast::<u8>().add(known), size - known) };
    if beyond.iter().any(|byte| *byte != 0) {
        let problem =
            format!("{} sets fields that this version of the library does not know; use a newer library", T::NAME);
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    Ok(value)
}

/// Copies `value` to the caller's struct, up to the size that this struct states. The size field of the caller's struct
/// stays as it is.
///
/// # Safety
/// `to` leads to a struct of which as many bytes can be written as its first field states.
pub(super) unsafe fn write<T: Sized32>(to: *mut T, value: &T) -> Outcome {
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let size = unsafe { size_of_struct(to.cast_const())? };
    let known = size.min(size_of::<T>()) - size_of::<u32>();
    // SAFETY: the caller keeps the conditions under `# Safety`. The first four bytes of both structs, their size
    // fields, are skipped; after them, both structs have at least `known` bytes.
    unsafe {
        let from = (&raw const *value).cast::<u8>().add(size_of::<u32>());
        std::ptr::copy_nonoverlapping(from, to.cast::<u8>().add(size_of::<u32>()), known);
    }
    Ok(())
}

/// Writes a result to the caller's struct as [`write`] does. Errors: `to` is null; the message calls it `name`.
///
/// # Safety
/// `to` is null, or leads to a struct of which as many bytes can be written as its first field states.
pub(super) unsafe fn tell<T: Sized32>(to: *mut T, value: &T, name: &str) -> Outcome {
    if to.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; pass the address for the answer")));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    unsafe { write(to, value) }
}

/// Reads the size (bytes) in the first field of a caller's struct, and checks it.
///
/// # Safety
/// If `of` is aligned, a `u32` can be read at this address.
unsafe fn size_of_struct<T: Sized32>(of: *const T) -> Outcome<usize> {
    if !of.is_aligned() {
        return Err(Failure::new(palpate_status::Argument, format!("{} is not aligned", T::NAME)));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let size = unsafe { of.cast::<u32>().read() } as usize;
    if size < T::LEAST || size > 1 << 16 {
        let problem = format!("{0}.size is {size}; set it to sizeof({0})", T::NAME);
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    if !ends_whole::<T>(size) {
        let problem = format!("{0}.size is {size}, which cuts a field in two; set it to sizeof({0})", T::NAME);
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    Ok(size)
}

/// Reads a string of the caller. Errors: `text` is null or not UTF-8; the message calls it `name`.
///
/// # Safety
/// `text` is null, or leads to a string that is terminated by a zero byte and lives as long as the result is used.
pub(super) unsafe fn string<'a>(text: *const c_char, name: &str) -> Outcome<&'a str> {
    if text.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; give a string")));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| Failure::new(palpate_status::Argument, format!("{name} is not UTF-8")))
}

/// Borrows an array of the caller with `count` elements. The pointer may be null if `count` is 0.
///
/// # Safety
/// `from` is null, or leads to `count` elements that live as long as the result is used; any bytes are a valid `T`.
pub(super) unsafe fn array<'a, T>(from: *const T, count: usize, name: &str) -> Outcome<&'a [T]> {
    if count == 0 {
        return Ok(&[]);
    }
    if from.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null, but its count is {count}")));
    }
    let problem = match count.checked_mul(size_of::<T>()) {
        Some(bytes) if bytes <= isize::MAX as usize && from.is_aligned() => {
            // SAFETY: the caller keeps the conditions under `# Safety`; null, alignment and length were checked above.
            return Ok(unsafe { std::slice::from_raw_parts(from, count) });
        }
        Some(bytes) if bytes <= isize::MAX as usize => format!("{name} is not aligned"),
        _ => format!("{name} has {count} elements, more than fit into memory"),
    };
    Err(Failure::new(palpate_status::Argument, problem))
}

/// Borrows an array of `count` rows, stored one after another; each row has N numbers.
///
/// # Safety
/// `from` is null, or leads to `count` times N numbers that live as long as the result is used; any bytes are a valid
/// `T`.
pub(super) unsafe fn rows<'a, T, const N: usize>(from: *const T, count: usize, name: &str) -> Outcome<&'a [[T; N]]> {
    // SAFETY: the caller keeps the conditions under `# Safety`; `[T; N]` is aligned as `T` is.
    unsafe { array(from.cast::<[T; N]>(), count, name) }
}

/// Copies an array of structs of the caller, whose size depends on the header that the caller was compiled with.
/// Errors: the structs do not all state the same size.
///
/// # Safety
/// `from` is null, or leads to `count` structs, each with as many bytes as the first field of the first one states.
pub(super) unsafe fn structs<T: Sized32>(from: *const T, count: usize, name: &str) -> Outcome<Vec<T>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    // SAFETY: the caller keeps the conditions under `# Safety`, so the first field of the first struct can be read.
    let size = unsafe {
        array(from.cast::<u32>(), 1, name)?;
        size_of_struct(from)?
    };
    if count.checked_mul(size).is_none_or(|bytes| bytes > isize::MAX as usize) {
        let problem = format!("{name} has {count} elements, more than fit into memory");
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    let one = |k: usize| {
        // SAFETY: the caller keeps the conditions under `# Safety`.
        let at = unsafe { from.byte_add(k * size) };
        // SAFETY: the caller keeps the conditions under `# Safety`.
        match unsafe { size_of_struct(at)? } == size {
            // SAFETY: the caller keeps the conditions under `# Safety`.
            true => unsafe { read(at) },
            false => {
                let problem = format!("{name}[{k}].size is not that of the first; set all to sizeof({})", T::NAME);
                Err(Failure::new(palpate_status::Argument, problem))
            }
        }
    };
    (0..count).map(one).collect()
}

/// Borrows a variable of the caller that receives a result. Errors: `to` is null; the message calls it `name`.
///
/// # Safety
/// `to` is null, or leads to a variable that can be written as long as the result is used.
pub(super) unsafe fn answer<'a, T>(to: *mut T, name: &str) -> Outcome<&'a mut T> {
    if !to.is_aligned() {
        return Err(Failure::new(palpate_status::Argument, format!("{name} is not aligned")));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let to = unsafe { to.as_mut() };
    to.ok_or_else(|| Failure::new(palpate_status::Null, format!("{name} is null; pass the address for the answer")))
}

/// Borrows a value to which the caller passes a pointer; if the pointer is null, the result is `None`.
///
/// # Safety
/// `from` is null, or leads to a value that can be read as long as the result is used.
pub(super) unsafe fn given<'a, T>(from: *const T, name: &str) -> Outcome<Option<&'a T>> {
    match from.is_aligned() {
        // SAFETY: the caller keeps the conditions under `# Safety`.
        true => Ok(unsafe { from.as_ref() }),
        false => Err(Failure::new(palpate_status::Argument, format!("{name} is not aligned"))),
    }
}

/// Copies all elements of `from` into the caller's array `to`, which has room for `capacity` elements. Errors: the
/// array is null or too small; then nothing is copied.
///
/// # Safety
/// `to` is null, or leads to room for `capacity` elements.
pub(super) unsafe fn copy<T: Copy>(from: &[T], to: *mut T, capacity: usize, name: &str) -> Outcome {
    if to.is_null() && capacity > 0 {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null, but its capacity is {capacity}")));
    }
    if !to.is_aligned() {
        return Err(Failure::new(palpate_status::Argument, format!("{name} is not aligned")));
    }
    if capacity < from.len() {
        let problem = format!("{name} has room for {capacity} elements, but there are {}", from.len());
        return Err(Failure::new(palpate_status::TooSmall, problem));
    }
    if !from.is_empty() {
        // SAFETY: the caller keeps the conditions under `# Safety`; the slice `from` is the library's own memory, so
        // the two do not overlap.
        unsafe { std::ptr::copy_nonoverlapping(from.as_ptr(), to, from.len()) };
    }
    Ok(())
}

/// Answers a call that lists things: writes their number to `count`, and copies them into the caller's array `to`, which
/// has room for `capacity` of them. A caller who only asks for the number passes a capacity of 0. Errors: as those of
/// [`copy`].
///
/// # Safety
/// `to` is null, or leads to room for `capacity` elements.
pub(super) unsafe fn list<T: Copy>(from: &[T], to: *mut T, capacity: usize, count: &mut usize, name: &str) -> Outcome {
    *count = from.len();
    // SAFETY: the caller keeps the conditions under `# Safety`.
    if capacity == 0 { Ok(()) } else { unsafe { copy(from, to, capacity, name) } }
}

#[cfg(test)]
mod tests {
    use super::super::change::{palpate_contact_law, palpate_coupling, palpate_material};
    use super::super::context::palpate_context_options;
    use super::super::describe::{palpate_body, palpate_core, palpate_settings, palpate_tool};
    use super::super::haptic_device::palpate_haptic_device;
    use super::super::host::palpate_vulkan;
    use super::super::loop_options::palpate_loop_options;
    use super::super::loop_state::palpate_loop_state;
    use super::super::shown::palpate_skins;
    use super::super::simulation::palpate_wrench;
    use super::*;

    /// A struct whose first version ended with `old`, so that an older program does not know `new`.
    #[repr(C)]
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Grown {
        size: u32,
        old: u32,
        new: u32,
    }

    // SAFETY: the struct is `repr(C)`, its first field is its size, and all fields are numbers, so any bytes are a
    // value.
    unsafe impl Sized32 for Grown {
        const NAME: &str = "grown";
        const LEAST: usize = 8;
        const FIELDS: &'static [Field] = fields!(Grown { size, old, new });

        fn unset() -> Self {
            Grown { size: 12, old: 1, new: 2 }
        }
    }

    #[test]
    fn what_an_older_program_does_not_know_is_neither_read_nor_written() {
        let mut given = Grown { size: 8, old: 5, new: 77 };
        // SAFETY (all unsafe blocks of this test): the struct has at least as many bytes as its size field states.
        assert_eq!(unsafe { read(&given) }.unwrap(), Grown { size: 8, old: 5, new: 2 });
        unsafe { write(&mut given, &Grown { size: 12, old: 6, new: 9 }) }.unwrap();
        assert_eq!(given, Grown { size: 8, old: 6, new: 77 });
        given.size = 7;
        assert!(unsafe { read(&given) }.unwrap_err().message.contains("grown.size is 7"));
    }

    /// A struct with padding: there is padding before `large`, and `bytes` begins where there was padding at the end of
    /// an earlier version, whose last field was `half`.
    #[repr(C, align(8))]
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Padded {
        size: u32,
        old: u32,
        small: u8,
        large: u64,
        half: u32,
        bytes: [u8; 8],
    }

    // SAFETY: the struct is `repr(C)`, its first field is its size, and all fields are numbers, so any bytes are a
    // value.
    unsafe impl Sized32 for Padded {
        const NAME: &str = "padded";
        const LEAST: usize = 8;
        const FIELDS: &'static [Field] = fields!(Padded { size, old, small, large, half, bytes });

        fn unset() -> Self {
            Padded { size: 40, old: 0, small: 0, large: 0, half: 0, bytes: [0; 8] }
        }
    }

    #[test]
    fn sizes_of_all_versions_are_taken_and_no_others() {
        // Counted by hand: the field `old` ends at byte 8; `small` ends at byte 9, and the padding after it at 16;
        // `large` ends at byte 24; `half` ends at byte 28, where `bytes` begins; `bytes` ends at byte 36, and the
        // padding after it at 40.
        let taken: Vec<usize> = (8..43).filter(|size| ends_whole::<Padded>(*size)).collect();
        assert_eq!(taken, [8, 9, 16, 24, 28, 36, 40, 41, 42]);
        let taken: Vec<usize> = (8..14).filter(|size| ends_whole::<Grown>(*size)).collect();
        assert_eq!(taken, [8, 12, 13]);
        let taken: Vec<usize> = (16..=50).filter(|size| ends_whole::<palpate_context_options>(*size)).collect();
        if size_of::<*const u8>() == 8 {
            assert_eq!(taken, [16, 24, 32, 40, 44, 48, 49, 50]);
        }
    }

    /// Tries to read and write a struct whose size field states each size from 0 to 16 bytes more than its true size,
    /// checks which of these sizes are accepted, and returns the name of the struct.
    fn try_every_size<T: Sized32>() -> &'static str {
        let (name, whole) = (T::NAME, size_of::<T>());
        let fields = T::FIELDS;
        // The list `FIELDS` covers the whole struct: its first element is the size field, and between two successive
        // elements, and after the last element, there is nothing but padding.
        assert_eq!(fields[0], Field { start: 0, end: 4 }, "place of the first field of {name}");
        for pair in fields.windows(2) {
            assert!(
                pair[0].end <= pair[1].start && pair[1].start - pair[0].end < align_of::<T>(),
                "two successive fields of {name} overlap, or are apart by more than padding: {pair:?}"
            );
        }
        assert_eq!(
            fields[fields.len() - 1].end.next_multiple_of(align_of::<T>()),
            whole,
            "end of the last field of {name}, with padding, and size of the struct"
        );
        let mut taken = 0;
        for size in 0..=whole + 16 {
            // `place` is the memory of the struct, aligned for any field. All bytes but those of the size field are
            // zero.
            let mut place = vec![0u64; (whole + 16).div_ceil(8)];
            let pointer = place.as_mut_ptr().cast::<T>();
            // SAFETY (all unsafe blocks of this loop): `place` has at least as many bytes as the size field states, and
            // zero is a valid value of every field.
            unsafe { pointer.cast::<u32>().write(size as u32) };
            let is_cut = fields.iter().any(|field| field.start < size && size < field.end);
            match unsafe { read(pointer.cast_const()) } {
                Ok(_) => {
                    assert!(size >= T::LEAST && !is_cut, "{name} was accepted with a wrong size of {size} bytes");
                    unsafe { write(pointer, &T::unset()) }.unwrap();
                    taken += 1;
                }
                Err(failure) => {
                    let message = failure.message;
                    assert!(
                        message.starts_with(&format!("{name}.size is {size}")),
                        "the error does not begin with `{name}.size is {size}`: {message}"
                    );
                    assert!(message.ends_with(&format!("set it to sizeof({name})")) && !message.contains('\n'));
                    let is_end = fields.iter().any(|field| field.end == size);
                    assert!(
                        size < T::LEAST || !is_end && size < whole,
                        "{name} was refused with an allowed size of {size} bytes: {message}"
                    );
                    assert!(
                        unsafe { write(pointer, &T::unset()) }.is_err(),
                        "{name} was written with a wrong size of {size} bytes"
                    );
                }
            }
        }
        assert!(taken >= 17, "only {taken} sizes of {name} were accepted");
        name
    }

    #[test]
    fn no_struct_of_the_interface_is_cut_within_a_field() {
        let tried = [
            try_every_size::<palpate_context_options>(),
            try_every_size::<palpate_vulkan>(),
            try_every_size::<palpate_wrench>(),
            try_every_size::<palpate_material>(),
            try_every_size::<palpate_contact_law>(),
            try_every_size::<palpate_coupling>(),
            try_every_size::<palpate_settings>(),
            try_every_size::<palpate_core>(),
            try_every_size::<palpate_body>(),
            try_every_size::<palpate_tool>(),
            try_every_size::<palpate_skins>(),
            try_every_size::<palpate_haptic_device>(),
            try_every_size::<palpate_loop_options>(),
            try_every_size::<palpate_loop_state>(),
        ];
        // `tried` must name every struct of the header whose size field the caller sets. In the header, the comment on
        // the size field of these structs, and of no other structs, contains "sizeof(".
        let header = include_str!("palpate.h");
        let sized = header.split("typedef struct ").skip(1).filter(|text| {
            let body = text.split_once('}').map_or("", |(body, _)| body);
            body.contains("sizeof(")
        });
        let mut named: Vec<&str> = sized.map(|text| text.split([' ', '{']).next().unwrap()).collect();
        let mut tried = tried.to_vec();
        named.sort_unstable();
        tried.sort_unstable();
        assert_eq!(named, tried);
    }

    #[test]
    fn what_a_newer_program_sets_is_refused_and_its_zeros_are_not() {
        let mut given = [16u32, 5, 6, 0];
        let pointer = (&raw const given).cast::<Grown>();
        // SAFETY (both calls of `read`): the size field states sixteen bytes, and the array has sixteen bytes.
        assert_eq!(unsafe { read(pointer) }.unwrap(), Grown { size: 16, old: 5, new: 6 });
        given[3] = 1;
        let pointer = (&raw const given).cast::<Grown>();
        assert!(unsafe { read(pointer) }.unwrap_err().message.contains("does not know"));
    }

    #[test]
    fn arrays_of_structs_go_by_the_size_that_the_first_says() {
        let old = [8u32, 5, 8, 6, 8, 7];
        let pointer = (&raw const old).cast::<Grown>();
        // SAFETY (all unsafe blocks of this test): the arrays have as many bytes as the library reads for the given
        // count and the size that their first number states.
        let all = unsafe { structs(pointer, 3, "all") }.unwrap();
        assert_eq!(all, [5, 6, 7].map(|old| Grown { size: 8, old, new: 2 }));
        let mixed = [8u32, 5, 12, 6, 1];
        let pointer = (&raw const mixed).cast::<Grown>();
        let message = |count| unsafe { structs(pointer, count, "all") }.unwrap_err().message;
        assert!(message(2).contains("all[1].size is not that of the first"), "wrong error: {}", message(2));
        assert!(message(usize::MAX / 4).contains("more than fit into memory"));
        assert!(unsafe { structs::<Grown>(std::ptr::null(), 0, "all") }.unwrap().is_empty());
        assert_eq!(unsafe { structs::<Grown>(std::ptr::null(), 1, "all") }.unwrap_err().status, palpate_status::Null);
    }

    #[test]
    fn arrays_that_cannot_be_are_told_and_not_looked_at() {
        let numbers = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        // SAFETY (all unsafe blocks of this test): if the library accepts a count, the array has that many elements.
        let rows = |count| unsafe { rows::<f64, 3>(numbers.as_ptr(), count, "rows") };
        assert_eq!(rows(2).unwrap(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert!(rows(0).unwrap().is_empty());
        for count in [usize::MAX, usize::MAX / 24 + 1, isize::MAX as usize / 24 + 1] {
            assert!(rows(count).unwrap_err().message.contains("more than fit into memory"));
        }
        let odd = numbers.as_ptr().wrapping_byte_add(4);
        assert!(unsafe { array(odd, 1, "odd") }.unwrap_err().message.contains("odd is not aligned"));
        assert_eq!(unsafe { array::<u8>(std::ptr::null(), 1, "no") }.unwrap_err().status, palpate_status::Null);
    }
}
