//! Structs that may grow, and strings, as they come from C and go there.

use std::ffi::{CStr, c_char};

use super::status::{Failure, Outcome, palpate_status};

/// A struct of the interface whose first field is its size in bytes, as its user was compiled with it.
///
/// # Safety
/// `repr(C)`, the first field is a `u32` of the size, and any bytes are a value.
pub(super) unsafe trait Sized32: Copy {
    /// As in the header.
    const NAME: &str;
    /// Size of the first version of it.
    const LEAST: usize;
    /// All its fields, in order, as [`fields!`] lists them.
    const FIELDS: &'static [Field];
    /// What the fields are that a user does not know of.
    fn unset() -> Self;
}

/// Where a field begins and ends in its struct, B.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Field {
    pub start: usize,
    pub end: usize,
}

impl Field {
    /// A field at `start`, as large as what a reference to it leads to.
    pub const fn at<S, F>(start: usize, _: fn(&S) -> &F) -> Field {
        Field { start, end: start + size_of::<F>() }
    }
}

/// [`Sized32::FIELDS`] of a struct. One that leaves a field out, or names one that is none, does not compile.
macro_rules! fields {
    ($name:ident { $($field:ident),+ $(,)? }) => {{
        const _: fn(&$name) = |whole| {
            let $name { $($field: _),+ } = whole;
        };
        &[$($crate::sized::Field::at(std::mem::offset_of!($name, $field), |whole: &$name| &whole.$field)),+]
    }};
}
pub(super) use fields;

/// Whether a user's struct may have this size: no field is cut, whichever version of it the user was compiled with. It ends
/// where a field does, or at the padding's end behind it, which sizeof of a version that ended there counts; or it is as large
/// as the struct is now, or larger.
fn ends_whole<T: Sized32>(size: usize) -> bool {
    let starts = T::FIELDS.iter().skip(1).map(|field| field.start).chain([size_of::<T>()]);
    let padded =
        |field: &Field, next: usize| Some(field.end.next_multiple_of(align_of::<T>())).filter(|end| *end <= next);
    let is_end =
        T::FIELDS.iter().zip(starts).any(|(field, next)| size == field.end || padded(field, next) == Some(size));
    is_end || size >= size_of::<T>()
}

/// Reads a struct of any known version; null: nothing is set.
///
/// # Safety
/// `from` is null, or that many bytes can be read there as its first field says.
pub(super) unsafe fn read<T: Sized32>(from: *const T) -> Outcome<T> {
    let mut value = T::unset();
    if from.is_null() {
        return Ok(value);
    }
    // SAFETY: the caller's promise.
    let size = unsafe { size_of_struct(from)? };
    let known = size.min(size_of::<T>());
    // SAFETY: the caller's promise, and any bytes are a value; `value` has room for `known`.
    unsafe { std::ptr::copy_nonoverlapping(from.cast::<u8>(), (&raw mut value).cast::<u8>(), known) };
    // SAFETY: the caller's promise.
    let beyond = unsafe { std::slice::from_raw_parts(from.cast::<u8>().add(known), size - known) };
    if beyond.iter().any(|byte| *byte != 0) {
        let problem = format!("{} sets what this version of the library does not know; use a newer one", T::NAME);
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    Ok(value)
}

/// Writes a struct as far as its user knows it; its size stays.
///
/// # Safety
/// As many bytes can be written at `to` as its first field says.
pub(super) unsafe fn write<T: Sized32>(to: *mut T, value: &T) -> Outcome {
    // SAFETY: the caller's promise.
    let size = unsafe { size_of_struct(to.cast_const())? };
    let known = size.min(size_of::<T>()) - size_of::<u32>();
    // SAFETY: the caller's promise; `value` is at least as large, and its first four bytes are the size.
    unsafe {
        let from = (&raw const *value).cast::<u8>().add(size_of::<u32>());
        std::ptr::copy_nonoverlapping(from, to.cast::<u8>().add(size_of::<u32>()), known);
    }
    Ok(())
}

/// Tells the caller a struct, as [`write`]; null is refused.
///
/// # Safety
/// `to` is null, or as many bytes can be written there as its first field says.
pub(super) unsafe fn tell<T: Sized32>(to: *mut T, value: &T, name: &str) -> Outcome {
    if to.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; say where the answer goes")));
    }
    // SAFETY: the caller's promise.
    unsafe { write(to, value) }
}

/// # Safety
/// A `u32` can be read at `of`.
unsafe fn size_of_struct<T: Sized32>(of: *const T) -> Outcome<usize> {
    if !of.is_aligned() {
        return Err(Failure::new(palpate_status::Argument, format!("{} is not aligned", T::NAME)));
    }
    // SAFETY: the caller's promise.
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

/// A string of the caller's.
///
/// # Safety
/// `text` is null, or ends in a zero and lives as long as the answer is used.
pub(super) unsafe fn string<'a>(text: *const c_char, name: &str) -> Outcome<&'a str> {
    if text.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; give a string")));
    }
    // SAFETY: the caller's promise.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| Failure::new(palpate_status::Argument, format!("{name} is not UTF-8")))
}

/// An array of the caller's; null where there are none.
///
/// # Safety
/// `from` is null or leads to that many, which live as long as the answer is used; any bytes are a `T`.
pub(super) unsafe fn array<'a, T>(from: *const T, count: usize, name: &str) -> Outcome<&'a [T]> {
    if count == 0 {
        return Ok(&[]);
    }
    if from.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null, and there are {count}")));
    }
    let problem = match count.checked_mul(size_of::<T>()) {
        Some(bytes) if bytes <= isize::MAX as usize && from.is_aligned() => {
            // SAFETY: the caller's promise, and what is checked above.
            return Ok(unsafe { std::slice::from_raw_parts(from, count) });
        }
        Some(bytes) if bytes <= isize::MAX as usize => format!("{name} is not aligned"),
        _ => format!("{name} has {count} elements, which is more than any memory"),
    };
    Err(Failure::new(palpate_status::Argument, problem))
}

/// An array of rows of N numbers, one after another.
///
/// # Safety
/// As [`array`], with N numbers to each.
pub(super) unsafe fn rows<'a, T, const N: usize>(from: *const T, count: usize, name: &str) -> Outcome<&'a [[T; N]]> {
    // SAFETY: the caller's promise; rows are aligned as their numbers are.
    unsafe { array(from.cast::<[T; N]>(), count, name) }
}

/// An array of structs that may grow, all of the size that the first says.
///
/// # Safety
/// `from` is null or leads to that many.
pub(super) unsafe fn structs<T: Sized32>(from: *const T, count: usize, name: &str) -> Outcome<Vec<T>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    // SAFETY: the caller's promise: the size of the first of them can be read.
    let size = unsafe {
        array(from.cast::<u32>(), 1, name)?;
        size_of_struct(from)?
    };
    if count.checked_mul(size).is_none_or(|bytes| bytes > isize::MAX as usize) {
        let problem = format!("{name} has {count} elements, which is more than any memory");
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    let one = |k: usize| {
        // SAFETY: the caller's promise.
        let at = unsafe { from.byte_add(k * size) };
        // SAFETY: the caller's promise.
        match unsafe { size_of_struct(at)? } == size {
            // SAFETY: the caller's promise.
            true => unsafe { read(at) },
            false => {
                let problem = format!("{name}[{k}].size is not that of the first; set all to sizeof({})", T::NAME);
                Err(Failure::new(palpate_status::Argument, problem))
            }
        }
    };
    (0..count).map(one).collect()
}

/// Where an answer is put.
///
/// # Safety
/// `to` is null or can be written for as long as the answer is used.
pub(super) unsafe fn answer<'a, T>(to: *mut T, name: &str) -> Outcome<&'a mut T> {
    if !to.is_aligned() {
        return Err(Failure::new(palpate_status::Argument, format!("{name} is not aligned")));
    }
    // SAFETY: the caller's promise.
    let to = unsafe { to.as_mut() };
    to.ok_or_else(|| Failure::new(palpate_status::Null, format!("{name} is null; say where the answer goes")))
}

/// What the caller gives by a pointer; `None`: null.
///
/// # Safety
/// `from` is null or can be read for as long as the answer is used.
pub(super) unsafe fn given<'a, T>(from: *const T, name: &str) -> Outcome<Option<&'a T>> {
    match from.is_aligned() {
        // SAFETY: the caller's promise.
        true => Ok(unsafe { from.as_ref() }),
        false => Err(Failure::new(palpate_status::Argument, format!("{name} is not aligned"))),
    }
}

/// Copies as many elements as there are into the caller's array. Errors: it is too small, and nothing was copied.
///
/// # Safety
/// `to` is null or has room for `capacity` elements.
pub(super) unsafe fn copy<T: Copy>(from: &[T], to: *mut T, capacity: usize, name: &str) -> Outcome {
    if to.is_null() && capacity > 0 {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null, and has room for {capacity}")));
    }
    if !to.is_aligned() {
        return Err(Failure::new(palpate_status::Argument, format!("{name} is not aligned")));
    }
    if capacity < from.len() {
        let problem = format!("{name} has room for {capacity} of {}", from.len());
        return Err(Failure::new(palpate_status::TooSmall, problem));
    }
    if !from.is_empty() {
        // SAFETY: the caller's promise; `from` is the library's own.
        unsafe { std::ptr::copy_nonoverlapping(from.as_ptr(), to, from.len()) };
    }
    Ok(())
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

    /// As it is, and as a program that is older knows it.
    #[repr(C)]
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Grown {
        size: u32,
        old: u32,
        new: u32,
    }

    // SAFETY: `repr(C)`, the size comes first, and all of it are numbers.
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
        // SAFETY (all here): places of the size that they say.
        assert_eq!(unsafe { read(&given) }.unwrap(), Grown { size: 8, old: 5, new: 2 });
        unsafe { write(&mut given, &Grown { size: 12, old: 6, new: 9 }) }.unwrap();
        assert_eq!(given, Grown { size: 8, old: 6, new: 77 });
        given.size = 7;
        assert!(unsafe { read(&given) }.unwrap_err().message.contains("grown.size is 7"));
    }

    /// Grown by a field that begins behind padding, and by one that begins where another version had padding.
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

    // SAFETY: `repr(C)`, the size comes first, and all of it are numbers.
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
        // By hand: old ends at 8; small at 9, padded to 16; large at 24; half at 28, where bytes begin; bytes at 36, padded to 40.
        let taken: Vec<usize> = (8..43).filter(|size| ends_whole::<Padded>(*size)).collect();
        assert_eq!(taken, [8, 9, 16, 24, 28, 36, 40, 41, 42]);
        let taken: Vec<usize> = (8..14).filter(|size| ends_whole::<Grown>(*size)).collect();
        assert_eq!(taken, [8, 12, 13]);
        let taken: Vec<usize> = (16..=50).filter(|size| ends_whole::<palpate_context_options>(*size)).collect();
        if size_of::<*const u8>() == 8 {
            assert_eq!(taken, [16, 24, 32, 40, 44, 48, 49, 50]);
        }
    }

    /// Asks for a struct of every size from none to more than it has, and gives its name.
    fn try_every_size<T: Sized32>() -> &'static str {
        let (name, whole) = (T::NAME, size_of::<T>());
        let fields = T::FIELDS;
        // The list is all of the struct: it begins with the size, leaves no gap but padding, and ends where the struct does.
        assert_eq!(fields[0], Field { start: 0, end: 4 }, "{name}");
        for pair in fields.windows(2) {
            assert!(pair[0].end <= pair[1].start && pair[1].start - pair[0].end < align_of::<T>(), "{name}: {pair:?}");
        }
        assert_eq!(fields[fields.len() - 1].end.next_multiple_of(align_of::<T>()), whole, "{name}");
        let mut taken = 0;
        for size in 0..=whole + 16 {
            // Aligned as any struct is, zero but for the size.
            let mut place = vec![0u64; (whole + 16).div_ceil(8)];
            let pointer = place.as_mut_ptr().cast::<T>();
            // SAFETY (all here): there are as many bytes as the size says, and zero is a value of every field.
            unsafe { pointer.cast::<u32>().write(size as u32) };
            let is_cut = fields.iter().any(|field| field.start < size && size < field.end);
            match unsafe { read(pointer.cast_const()) } {
                Ok(_) => {
                    assert!(size >= T::LEAST && !is_cut, "{name} of {size}");
                    unsafe { write(pointer, &T::unset()) }.unwrap();
                    taken += 1;
                }
                Err(failure) => {
                    let message = failure.message;
                    assert!(message.starts_with(&format!("{name}.size is {size}")), "{message}");
                    assert!(message.ends_with(&format!("set it to sizeof({name})")) && !message.contains('\n'));
                    let is_end = fields.iter().any(|field| field.end == size);
                    assert!(size < T::LEAST || !is_end && size < whole, "{name} of {size}: {message}");
                    assert!(unsafe { write(pointer, &T::unset()) }.is_err(), "{name} of {size}");
                }
            }
        }
        assert!(taken >= 17, "{name}: {taken}");
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
        // Every struct of the header that says its own size is among them; the library itself writes the size of the others.
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
        // SAFETY (both): sixteen bytes, as it says.
        assert_eq!(unsafe { read(pointer) }.unwrap(), Grown { size: 16, old: 5, new: 6 });
        given[3] = 1;
        let pointer = (&raw const given).cast::<Grown>();
        assert!(unsafe { read(pointer) }.unwrap_err().message.contains("does not know"));
    }

    #[test]
    fn arrays_of_structs_go_by_the_size_that_the_first_says() {
        let old = [8u32, 5, 8, 6, 8, 7];
        let pointer = (&raw const old).cast::<Grown>();
        // SAFETY (all here): as many bytes as are counted, where they are looked at.
        let all = unsafe { structs(pointer, 3, "all") }.unwrap();
        assert_eq!(all, [5, 6, 7].map(|old| Grown { size: 8, old, new: 2 }));
        let mixed = [8u32, 5, 12, 6, 1];
        let pointer = (&raw const mixed).cast::<Grown>();
        let message = |count| unsafe { structs(pointer, count, "all") }.unwrap_err().message;
        assert!(message(2).contains("all[1].size is not that of the first"), "{}", message(2));
        assert!(message(usize::MAX / 4).contains("more than any memory"));
        assert!(unsafe { structs::<Grown>(std::ptr::null(), 0, "all") }.unwrap().is_empty());
        assert_eq!(unsafe { structs::<Grown>(std::ptr::null(), 1, "all") }.unwrap_err().status, palpate_status::Null);
    }

    #[test]
    fn arrays_that_cannot_be_are_told_and_not_looked_at() {
        let numbers = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        // SAFETY (all here): as many numbers as are counted, where they are looked at.
        let rows = |count| unsafe { rows::<f64, 3>(numbers.as_ptr(), count, "rows") };
        assert_eq!(rows(2).unwrap(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert!(rows(0).unwrap().is_empty());
        for count in [usize::MAX, usize::MAX / 24 + 1, isize::MAX as usize / 24 + 1] {
            assert!(rows(count).unwrap_err().message.contains("more than any memory"));
        }
        let odd = numbers.as_ptr().wrapping_byte_add(4);
        assert!(unsafe { array(odd, 1, "odd") }.unwrap_err().message.contains("odd is not aligned"));
        assert_eq!(unsafe { array::<u8>(std::ptr::null(), 1, "no") }.unwrap_err().status, palpate_status::Null);
    }
}
