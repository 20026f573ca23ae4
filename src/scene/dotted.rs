//! Values of a scene's tables by dotted keys, such as `body.head.material.young`, for programs that vary a scene. A
//! table of a list is meant by its name or by its index; where the list has a single table, both may be left out.

use toml::{Table, Value};

use crate::{Error, Result};

/// Sets a value; tables on the way to it are made where they are missing.
///
/// # Errors
/// The key leads into a value that is no table, or does not say which table of a list is meant.
pub fn set(tables: &mut Table, key: &str, value: Value) -> Result<()> {
    let steps: Vec<&str> = key.split('.').collect();
    let (last, path) = steps.split_last().ok_or_else(|| nowhere(key))?;
    descend(tables, path, key)?.insert((*last).into(), value);
    Ok(())
}

/// The value of a key; `None` where the tables leave it out.
///
/// # Errors
/// Those of [`set`].
pub fn get(tables: &Table, key: &str) -> Result<Option<Value>> {
    let steps: Vec<&str> = key.split('.').collect();
    let (last, path) = steps.split_last().ok_or_else(|| nowhere(key))?;
    Ok(descend(&mut tables.clone(), path, key)?.get(*last).cloned())
}

/// The table at a path; `key` is for messages.
fn descend<'a>(table: &'a mut Table, path: &[&str], key: &str) -> Result<&'a mut Table> {
    let Some((first, rest)) = path.split_first() else { return Ok(table) };
    match table.entry(*first).or_insert_with(|| Value::Table(Table::new())) {
        Value::Table(inner) => descend(inner, rest, key),
        Value::Array(list) => {
            let (index, rest) = element(list, rest, key)?;
            let inner = list[index].as_table_mut().ok_or_else(|| nowhere(key))?;
            descend(inner, rest, key)
        }
        _ => Err(nowhere(key)),
    }
}

/// Index of the element of a list that the next step of a path means, and the steps after that.
fn element<'p, 'k>(list: &[Value], path: &'p [&'k str], key: &str) -> Result<(usize, &'p [&'k str])> {
    let names = || list.iter().map(|item| item.get("name").and_then(Value::as_str));
    if let Some((step, rest)) = path.split_first() {
        let named = names().position(|name| name == Some(*step));
        let numbered = step.parse().ok().filter(|index| *index < list.len());
        if let Some(index) = named.or(numbered) {
            return Ok((index, rest));
        }
    }
    if list.len() == 1 {
        return Ok((0, path));
    }
    let all: Vec<String> =
        names().zip(0..).map(|(name, index)| name.map_or(format!("{index}"), String::from)).collect();
    Err(Error::Usage(format!("{key}: does not say which of {}; add one of these to the key", all.join(", "))))
}

fn nowhere(key: &str) -> Error {
    Error::Usage(format!("{key}: leads into a value that is no table; give a key of the scene"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tables() -> Table {
        let text =
            "[step]\ndt = 0.002\n[[body]]\nname = \"a\"\nmaterial = { young = 1.0 }\n[[body.core]]\nname = \"c\"\n";
        text.parse().unwrap()
    }

    #[test]
    fn keys_lead_through_tables_and_lists() {
        for key in ["body.material.young", "body.a.material.young", "body.0.material.young"] {
            let mut changed = tables();
            set(&mut changed, key, Value::Float(2.0)).unwrap();
            assert_eq!(get(&changed, "body.a.material.young").unwrap(), Some(Value::Float(2.0)), "{key}");
            assert_eq!(changed["body"].as_array().unwrap().len(), 1);
        }
        assert_eq!(get(&tables(), "body.core.name").unwrap(), Some(Value::String("c".into())));
        assert_eq!(get(&tables(), "contact.friction").unwrap(), None);
        let mut changed = tables();
        set(&mut changed, "contact.friction", Value::Float(0.5)).unwrap();
        assert_eq!(changed["contact"]["friction"], Value::Float(0.5));
        set(&mut changed, "preset", Value::String("fast".into())).unwrap();
        assert_eq!(changed["preset"].as_str(), Some("fast"));
    }

    #[test]
    fn a_key_that_leads_nowhere_is_refused() {
        assert!(set(&mut tables(), "step.dt.more", Value::Float(1.0)).unwrap_err().to_string().contains("no table"));
        let mut two = tables();
        let second: Table = "name = \"b\"".parse().unwrap();
        two["body"].as_array_mut().unwrap().push(Value::Table(second));
        assert!(
            set(&mut two, "body.material.young", Value::Float(1.0)).unwrap_err().to_string().contains("which of a, b")
        );
        set(&mut two, "body.b.material.young", Value::Float(3.0)).unwrap();
        assert_eq!(get(&two, "body.1.material.young").unwrap(), Some(Value::Float(3.0)));
    }
}
