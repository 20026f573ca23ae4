//! Tests of measuring, merging and reading the results of benchmarks, with a benchmark that takes no time. A benchmark
//! has parts, which are measured one by one; a shard is a subset of the parts, for one of several machines. The head of
//! the results says which program and machine measured them.

use serde_json::json;

use super::*;

/// A benchmark whose parts have numbers as names, and whose measurement of a part is twice its number; part 13 fails.
struct Doubling(u32);

impl Benchmark for Doubling {
    fn name(&self) -> &'static str {
        "doubling"
    }

    fn title(&self) -> &'static str {
        "Doubles"
    }

    fn settings(&self) -> Result<Value> {
        to_value(&self.0)
    }

    fn parts(&self) -> Vec<String> {
        (0..self.0).map(|k| k.to_string()).collect()
    }

    fn measure(&self, part: &str, watch: &mut dyn FnMut(&str)) -> Result<Value> {
        watch(part);
        if part == "13" {
            return Err(Error::Simulation("bad luck".into()));
        }
        Ok((2 * part.parse::<u32>().unwrap()).into())
    }

    fn preface(&self, settings: &Value) -> Result<String> {
        Ok(format!("Up to {settings}."))
    }

    fn sections(&self, parts: &Map<String, Value>) -> Result<Vec<Section>> {
        let of = |(title, double): (&String, &Value)| Section {
            title: title.clone(),
            finding: double.to_string(),
            ..Section::default()
        };
        Ok(parts.iter().map(of).collect())
    }
}

fn head() -> Head {
    Head {
        schema: SCHEMA,
        version: "0".into(),
        commit: "c".into(),
        device: "d".into(),
        driver: "e".into(),
        depth_path: "compute".into(),
        is_cpu: true,
        threads: 2,
        is_quick: false,
    }
}

fn all() -> Vec<Box<dyn Benchmark>> {
    vec![Box::new(Doubling(5))]
}

fn measured(shard: Shard) -> Results {
    measure(&all(), head(), shard, &|_, part| part != "1", &mut |_| ()).unwrap().0
}

/// Results as JSON without the gauges (times of a fixed piece of work around each part), which are different in each
/// run.
fn without_gauges(results: &Results) -> Value {
    let mut value = serde_json::to_value(results).unwrap();
    let gauges = value["benchmarks"]["doubling"].as_object_mut().unwrap().remove("gauges").unwrap();
    assert_eq!(gauges.as_object().unwrap().len(), 4);
    value
}

#[test]
fn shards_joined_in_any_order_give_the_report_of_the_whole() {
    let whole = measured(Shard::WHOLE);
    let [one, two] = [0, 1].map(|index| measured(Shard { index, count: 2 }));
    let page = |results: &Results| document(&all(), results, None).unwrap().html();
    assert!(
        page(&one).contains("Not measured, or not merged yet: 2, 4."),
        "the first shard's page must name the parts without results: {}",
        page(&one)
    );
    let joined = merge(vec![(Path::new("b"), two), (Path::new("a"), one)]).unwrap();
    assert_eq!(page(&joined), page(&whole));
    assert!(whole.gauge("doubling/2").is_some() && whole.gauge("doubling/1").is_none());
    assert_eq!(without_gauges(&joined), without_gauges(&whole));
    assert!(!page(&joined).contains("Not measured") && page(&joined).contains("Up to 5."));
}

#[test]
fn what_does_not_belong_together_is_not_joined() {
    let shard = |index| measured(Shard { index, count: 2 });
    let refused = |results: Results| {
        merge(vec![(Path::new("first"), shard(0)), (Path::new("other"), results)]).unwrap_err().to_string()
    };
    let twice = refused(shard(0));
    assert!(
        twice.contains("other") && twice.contains("`0` of `doubling`"),
        "the error must name the file and the part that two shards have: {twice}"
    );
    let elsewhere = refused(Results { head: Head { device: "x".into(), ..head() }, ..shard(1) });
    assert!(
        elsewhere.contains("other") && elsewhere.contains("differs in program, device"),
        "the error must name the file and say that its device differs from the first file's: {elsewhere}"
    );
    let mut changed = shard(1);
    changed.benchmarks["doubling"]["settings"] = json!(7);
    assert!(refused(changed).contains("other settings"));
    assert!(merge(Vec::new()).is_err());
}

#[test]
fn results_are_read_again_and_others_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("results.json");
    let write = |value: &Value| std::fs::write(&file, value.to_string()).unwrap();
    write(&to_value(&measured(Shard::WHOLE)).unwrap());
    assert_eq!(read(&file).unwrap().head, head());
    write(&json!({ "schema": 2 }));
    let error = read(&file).unwrap_err().to_string();
    assert!(
        error.contains("results.json") && error.contains("schema 2"),
        "the error must name the file and its schema: {error}"
    );
    std::fs::write(&file, "{").unwrap();
    assert!(read(&file).unwrap_err().to_string().contains("results.json:1"));
}

#[test]
fn what_fails_does_not_lose_the_rest() {
    let many: Vec<Box<dyn Benchmark>> = vec![Box::new(Doubling(15))];
    let (results, failed) = measure(&many, head(), Shard::WHOLE, &|_, _| true, &mut |_| ()).unwrap();
    assert_eq!(failed, ["doubling/13: bad luck"]);
    assert_eq!(results.benchmarks["doubling"]["parts"].as_object().unwrap().len(), 14);
    assert!(document(&many, &results, None).unwrap().html().contains("not merged yet: 13."));
}
