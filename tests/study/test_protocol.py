import pytest

from haptigraph.errors import BadInput, RenamedKey
from haptigraph.study.protocol import load_protocol
from haptigraph.study.questionnaire import load_questionnaire, questionnaire_names

INVALID = [
    ('design = "within"', 'design = "crossed"', r"line 5.*crossed.*between, within"),
    ("participants = 4", "participants = 0", r"line 6: study.participants: expected `?int`? >= 1, found 0"),
    ("participants = 4", "people = 4", r"line 6.*unknown key 'people'.*participants"),
    ('name = "small"', 'name = "so small"', r"line 3: study.name: expected `?str`? matching.*found 'so small'"),
    ('condition = "felt"', 'condition = "heard"', r"line 20.*unknown condition 'heard'.*felt, seen"),
    ('name = "felt"', 'name = "seen"', r"line 29.*a second condition 'seen'; names must differ"),
    ('name = "right"', 'name = "left"', r"line 37.*a second target 'left'"),
    ("along_mm = 3\n", "along_mm = 90\n", r"line 38.*<= 15.*found 90"),
    ("along_mm = 3\n", "along_mm = nan\n", r"line 38.*finite"),
    ('file = "sus"', 'file = "suss"', r"line 41.*did you mean 'sus'"),
    ('file = "sus"', 'file = "none.toml"', r"line 41.*none.toml.*No such file"),
    ("[[target]]", "[quality]\nmax_gap_s = -1\n\n[[target]]", r"line 33: quality.max_gap_s: expected `?float`? >= 0"),
    ("[[target]]", "[quality]\nmax_unseen_fraction = 20\n\n[[target]]", r"line 33: .*max_unseen_fraction.*<= 1.*found 20"),
    ("[[target]]", "[quality]\nmin_fps = 20\n\n[[target]]", r"line 33: unknown key 'min_fps'; valid: .*min_images_per_s"),
    ('when = "condition"', 'when = "later"', r"line 42.*later.*condition, end, start"),
    ('title = "Seen only"', 'title = "Seen only"\nprocedure = "cataract"', r"line 26.*unknown procedure 'cataract'"),
    ('before = "study"', 'before = "condition"', r"line 20: training before each condition uses that condition"),
    ('design = "within"', 'design = "between"', r"line 20: with design between, training uses"),
    ("[[target]]\n", "[[condition]]\ntouch = false\n", r"line 35: unknown key 'along_mm'; valid: display"),
    ('when = "condition"', 'when = "end"\n\n[[questionnaire]]\nfile = "sus"\nwhen = "end"', r"line 45.*'sus' occurs twice"),
    ('consent = "I agree."', 'consent = " "', r"line 11.*consent is empty"),
    ("seed = 1", "", r"line 2: study: key 'seed' is missing"),
    ("[study]", "[study", r"line 2.*not valid TOML"),
]  # fmt: skip


@pytest.mark.parametrize(("valid", "invalid", "message"), INVALID, ids=[case[1] for case in INVALID])
def test_an_invalid_protocol_is_refused_with_file_line_and_reason(folder, valid, invalid, message):
    file = folder / "study.toml"
    text = file.read_text()
    assert valid in text
    file.write_text(text.replace(valid, invalid, 1))
    with pytest.raises(BadInput, match=rf"study\.toml, {message}"):
        load_protocol(folder)


def test_a_missing_protocol_is_reported(tmp_path):
    with pytest.raises(BadInput, match=r"study.toml: cannot be read \(No such file"):
        load_protocol(tmp_path)


def test_named_procedures_and_questionnaires_are_part_of_the_protocol(folder, protocol, procedure):
    assert set(protocol.parts) == {"study.toml", "procedure subretinal_injection", "questionnaire sus"}
    own = folder / "own.toml"
    own.write_text(procedure.text)
    file = folder / "study.toml"
    file.write_text(file.read_text().replace("touch = false", 'procedure = "own.toml"'))
    before = load_protocol(folder)
    own.write_text(procedure.text + "\n# changed\n")
    after = load_protocol(folder)
    assert before.sha256 != after.sha256
    assert after.procedure_path(after.conditions[0]) == str(own)
    own.write_text(procedure.text.replace("at_most = 0.7", "at_most = ", 1))
    with pytest.raises(BadInput, match=r"own\.toml, line"):
        load_protocol(folder)


def test_procedures_and_questionnaires_may_be_reworded_but_not_changed(protocol, procedure):
    frozen = protocol.parts
    key, bound = "procedure subretinal_injection", "at_most = 0.7"
    assert bound in procedure.text
    assert protocol.changed_parts({**frozen, key: f"# as shipped before\n{procedure.text}"}) == []
    assert protocol.changed_parts({**frozen, key: procedure.text.replace(bound, "at_most = 0.6")}) == [key]
    key, sus = "questionnaire sus", frozen["questionnaire sus"]
    assert protocol.changed_parts({**frozen, key: sus.replace("low_label", "low_says")}) == []
    assert protocol.changed_parts({**frozen, key: sus.replace("agree", "concur")}) == [key]
    assert protocol.changed_parts({**frozen, key: "not TOML"}) == [key]
    start, end = sus.index("[score]"), sus.index("[[item]]")
    assert (
        protocol.changed_parts({**frozen, key: sus[:start] + sus[end:]}) == []
    )  # before scores were part of it
    assert protocol.changed_parts({**frozen, key: sus.replace("[0, 100]", "[0, 50]")}) == [key]
    assert protocol.changed_parts({key: sus}) == ["procedure subretinal_injection", "study.toml"]
    assert protocol.changed_parts({**frozen, "study.toml": frozen["study.toml"] + "#"}) == ["study.toml"]


def test_a_questionnaire_may_use_the_keys_of_an_earlier_version(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text(load_questionnaire("sus").text.replace("low_label", "low_says", 1))
    with pytest.warns(RenamedKey, match=r"own\.toml, line 19: key 'low_says' is now called 'low_label'"):
        items = load_questionnaire(str(file)).items
    assert items == load_questionnaire("sus").items


def test_sus_ships_as_published():
    sus = load_questionnaire("sus")
    assert questionnaire_names() == ["demographics", "nasa_tlx", "sus"]
    assert [item.key for item in sus.items] == [str(number) for number in range(1, 11)]
    assert {(item.kind, item.low, item.high) for item in sus.items} == {("scale", 1, 5)}
    assert sus.items[0].text == "I think that I would like to use this system frequently."
    assert sus.items[9].text.startswith("I needed to learn a lot of things before")


@pytest.mark.parametrize(
    ("name", "item", "valid", "invalid"),
    [
        ("sus", "1", ["1", "5", " 3 "], ["0", "6", "3.5", "", "good", "nan"]),
        ("demographics", "age_years", ["18", "34.5"], ["17", "nan", "inf", "old", ""]),
        ("demographics", "gender", ["female"], ["Female", "", "x"]),
    ],
)
def test_answers_are_checked(name, item, valid, invalid):
    question = load_questionnaire(name).item(item)
    for answer in valid:
        assert question.checked(answer) == answer.strip()
    for answer in invalid:
        with pytest.raises(BadInput, match=f"item '{item}': expected"):
            question.checked(answer)


@pytest.mark.parametrize(
    ("valid", "invalid", "message"),
    [
        ('key = "2"', 'key = "1"', "a second item '1'"),
        ("low = 1", "low = 7", "low below high"),
        ('key = "1"', 'key = "a b"', "matching"),
        ('kind = "scale"', 'kind = "choice"', "two different choices"),
    ],
)
def test_an_invalid_questionnaire_is_refused(tmp_path, valid, invalid, message):
    file = tmp_path / "own.toml"
    file.write_text(load_questionnaire("sus").text.replace(valid, invalid, 1))
    with pytest.raises(BadInput, match=rf"own\.toml, line.*{message}"):
        load_questionnaire(str(file))
