//! The table, its judgement and its files, on figures made up.

use super::{
    column::{Column, Costs, Shown, Spread, Unit},
    page,
    table::{About, Setting, Table, TableRow, Wording},
};

/// An own error, one against the reference, and one for its own time, which takes a tenth.
type Errors = [f64; 3];

type TestColumn = Column<Option<Errors>>;

const COLUMNS: [TestColumn; 5] = [
    TestColumn::new("own", "own", Unit::Percent, |errors| Some((*errors)?[0]))
        .criterion("own")
        .meaning("a & b"),
    TestColumn::new("distance", "distance", Unit::Spacings, |errors| Some((*errors)?[1]))
        .against_reference()
        .criterion("distance"),
    TestColumn::new("part.error", "part", Unit::Voxels, |errors| Some((*errors)?[2]))
        .criterion("part")
        .timed_by("part_seconds"),
    TestColumn::times("part_seconds", "", |_| Some(Spread::exact(0.1))).shown(Shown::Page),
    TestColumn::data("count", Unit::Count, |_| Some(3.0)).remark("things happened"),
];

static WORDING: Wording = Wording {
    whole: "the shot",
    seconds: "seconds",
    same: "the same as",
    criterion: "distance",
    limit: "off by {}",
    incomparable: Some("nothing to compare"),
};

fn row(label: &str, seconds: f64, errors: Option<Errors>) -> TableRow {
    let setting = Setting { label: label.into(), quality: None, set: vec!["a=1".into()] };
    let costs = Costs {
        seconds: Spread::exact(seconds),
        cpu_seconds: None,
        shot_seconds: 10.0 * seconds,
        memory: Some(1 << 25),
    };
    TableRow::new(&setting, &costs, &COLUMNS, &errors)
}

/// A spacing of half a metre, a reference uncertain by 0.01 m.
fn table(by: &str, rows: Vec<TableRow>) -> Table {
    let about = About {
        title: "A & B".into(),
        frames: "frames 1-5".into(),
        facts: vec![("frames", "1-5".into())],
        spacing: 0.5,
        remarks: vec![("note", "x < y".into())],
    };
    let references = [row("reference", 100.0, None), row("refined", 400.0, Some([0.0, 0.01, 0.0]))];
    Table::new(about, &WORDING, &COLUMNS, by, rows, references)
}

#[test]
fn errors_below_the_uncertainty_of_the_reference_buy_nothing() {
    let rows = [(1.0, 0.3), (2.0, 0.04), (8.0, 0.009), (20.0, 0.001), (9.0, 0.2)];
    let rows = rows.map(|(seconds, error)| row("a", seconds, Some([error, error, 0.05])));
    let mut found = table("distance", rows.to_vec());
    let [own, distance, part] = ["own", "distance", "part"].map(|by| found.column(by));
    assert_eq!((found.front(distance), found.front(own)), (vec![0, 1, 2], vec![0, 1, 2, 3]));
    assert_eq!(found.front(part), [0], "all parts took as long and came out alike");
    assert_eq!((found.judged(&found.rows[3], distance), found.knee), (Some(0.01), Some(1)));
    let chosen = |time, dev| found.choose(time, dev).unwrap();
    assert_eq!((chosen(None, None), chosen(Some(200.0), None)), (Some(1), Some(2)));
    assert_eq!(chosen(None, Some(0.1)), Some(1), "0.04 m are 8 % of a spacing");
    assert_eq!(chosen(None, Some(0.7)), Some(0));
    let none = found.choose(Some(30.0), Some(0.05)).unwrap_err().to_string();
    assert!(none.contains("30 s for the shot and off by 5%"), "{none}");

    // What cannot be compared is not chosen, and without a reference nothing is.
    found.rows[1].cells[distance] = None;
    found.rows[2].diverged = Some("frame 0002".into());
    assert_eq!(found.front(distance), [0, 4, 3]);
    assert_eq!(found.choose(None, Some(0.1)).unwrap(), Some(3));
    assert_eq!(found.incomparable(&found.rows[1]), Some("nothing to compare"));
    found.reference.diverged = Some("frame 0002".into());
    let lost = found.choose(Some(25.0), None).unwrap_err().to_string();
    assert!(lost.contains("--by own") && lost.contains("--by part"), "{lost}");
    found.by = own;
    assert_eq!(found.choose(Some(25.0), None).unwrap(), Some(1));
}

#[test]
fn rows_out_of_the_bounds_are_never_chosen() {
    const BOUNDED: [TestColumn; 2] = [
        TestColumn::new("volume", "volume", Unit::Change, |errors| Some((*errors)?[0])).bound(0.03),
        TestColumn::new("distance", "distance", Unit::Of("m"), |errors| Some((*errors)?[1]))
            .against_reference()
            .criterion("distance"),
    ];
    let table = |volumes: [f64; 3]| {
        let bounded = |place: usize| {
            let (setting, seconds) = (row("a", 1.0, None).setting, 1.0 + place as f64);
            let costs = Costs {
                seconds: Spread::exact(seconds),
                cpu_seconds: None,
                shot_seconds: seconds,
                memory: None,
            };
            let errors = Some([volumes[place], 0.1 / seconds.powi(3), 0.0]);
            TableRow::new(&setting, &costs, &BOUNDED, &errors)
        };
        let about = self::table("own", Vec::new()).about;
        let mut refined = bounded(2);
        refined.cells[5] = Some(Spread::exact(0.0));
        let rows = (0..3).map(bounded).collect();
        Table::new(about, &WORDING, &BOUNDED, "distance", rows, [bounded(2), refined])
    };
    let found = table([0.02, -0.031, f64::NAN]);
    assert_eq!([0, 1, 2].map(|place| found.rows[place].mark), ["front", "outside", "outside"]);
    assert_eq!(found.choose(Some(100.0), None).unwrap(), Some(0), "row 1 and 2 are nearer to the reference");
    assert_eq!(found.out_of_bounds(&found.rows[1], 2).unwrap(), "volume -3.10 % (±3 %)");
    assert_eq!((found.out_of_bounds(&found.rows[0], 2), found.are_all_outside()), (None, false));
    assert_eq!(found.json()["lines"][1]["outside"], serde_json::json!(["volume"]));
    assert_eq!(
        (&found.json()["bounds"]["volume"], &found.json()["lines"][1]["front"]),
        (&0.03.into(), &false.into())
    );
    let lost = table([0.1, 0.2, -0.3]);
    assert!(lost.are_all_outside() && lost.knee.is_none());
    let why = lost.choose(Some(100.0), None).unwrap_err().to_string();
    assert!(why.contains("100 s for the shot and the bounds of the table (volume ±3 %)"), "{why}");
    let legend = lost.legend(Shown::Everywhere, 2);
    assert!(
        legend.contains(&("outside", "not recommended; the bounds are volume ±3 %".into())),
        "{legend:?}"
    );
}

#[test]
fn files_hold_every_setting_and_are_well_formed() {
    let mut lost = row("x < y, \"z\"", 0.1, None);
    lost.diverged = Some("frame 0002: particle 1".into());
    let mut found = row("b", 2.0, Some([0.1, 0.001, 0.1]));
    found.passes = vec![("solve".into(), 1.5)];
    let found = table("own", vec![row("a", 1.0, Some([0.2, 0.2, 0.2])), lost, found]);
    let folder = tempfile::tempdir().unwrap();
    let [csv, svg, html] =
        page::write(&found, folder.path()).unwrap().map(|path| std::fs::read_to_string(path).unwrap());
    assert_eq!(csv.lines().count(), 6);
    let head =
        "label,set,seconds_median,seconds_min,seconds_max,shot_seconds,memory,own,apart_distance,part_error";
    assert!(
        csv.starts_with(head) && csv.contains("\"x < y, \"\"z\"\"\"") && csv.contains(",passes_solve"),
        "{csv}"
    );
    for text in [&svg, &html] {
        assert!(
            text.contains("x &lt; y, &quot;z") && !text.contains("x < y") && !text.contains("NaN"),
            "{text}"
        );
        assert_eq!(text.matches("<circle").count(), 3 * 2, "two points in three panels, and no knee");
        assert_eq!(text.matches("class=\"lost\"").count(), 3);
    }
    assert!(html.contains("A &amp; B") && html.contains("solve 1.5") && html.contains("≤ 0.02"), "{html}");
    let json = found.json();
    assert_eq!(
        (&json["uncertainty"]["distance"], &json["lines"][2]["part"]["error"]),
        (&0.01.into(), &0.1.into())
    );
    assert_eq!((&json["lines"][0]["count"], &json["by"]), (&3.into(), &"own".into()));
}
