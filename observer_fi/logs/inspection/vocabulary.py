"""The words and units by which engineers call their columns, in English, German, French, Italian and Spanish."""

import re
import unicodedata
from typing import NamedTuple

# Quantities of the contract, and those that are told apart from them only to be left out.
NAMES: dict[str, str] = {
    "time": "time t zeit temps tempo tiempo timestamp zeitstempel horodatage datetime date datum fecha data uhrzeit "
    "heure ora hora clock elapsed zeitpunkt",
    "voltage": "voltage volt volts spannung tension tensione voltaje klemmenspannung motorspannung u v vm um ua uk vmot umot "
    "vmotor umotor",
    "current": "current strom courant intensite corrente corriente i im ia iq imot imotor amps ampere amperage motorstrom curr "
    "ankerstrom",
    "position": "position pos weg x s hub lage course corsa posizione posicion deplacement spostamento desplazamiento stroke "
    "displacement travel distance dist carrera strecke stellung verfahrweg recorrido abstand location xpos posx y z schlitten",
    "pitch": "pitch neigung inclination inclinaison beccheggio inclinazione inclinacion assiette tangage theta tilt cabeceo "
    "nickwinkel nicken incl slope steigung",
    "angle": "encoder angle winkel phi theta motorwinkel angolo angulo drehwinkel rotorwinkel enc geber codeur resolver rotation "
    "rotor motorangle alpha",
    "speed": "speed velocity drehzahl geschwindigkeit vitesse velocita velocidad n omega w rpm vel regime giri "
    "winkelgeschwindigkeit motordrehzahl nmot",
    "force": "force kraft forza fuerza effort f thrust schub vorschubkraft",
    "load": "load last charge carico carga belastung weight gewicht fload externalload lastkraft",
    "temperature": "temperature temp temperatur temperatura celsius",
    "torque": "torque moment drehmoment couple coppia par",
    "power": "power leistung puissance potenza potencia",
    "supply": "supply bus battery batterie dc link zwischenkreis versorgung versorgungsspannung netz netzspannung bordnetz "
    "bat vbat vcc vin vdc vbus vsupply alimentation alimentazione alimentacion",
    "acceleration": "acc accel acceleration beschleunigung accelerazione aceleracion jerk ruck",
    "number": "index idx sample nr no number nummer id counter count zaehler row zeile cycle zyklus run group status state mode "
    "flag error fault code echantillon",
}  # fmt: skip
COMMANDED = (
    "soll cmd command commanded setpoint set sp ref reference target demand desired sollwert fuehrungsgroesse consigne cible "
    "riferimento consigna referencia goal vorgabe des dem setp request req comando"
)
MEASURED = (
    "ist act actual meas measured istwert mesure mesuree reel reelle misura misurato misurata attuale medido medida "
    "real feedback fb fbk mess"
)
DEVIATION = "error err abweichung fehler ecart erreur errore deviation schleppfehler regelabweichung desviacion scarto delta diff"
INSIDE = 4  # letters of a word that is found within a longer one: Motorstrom, Sollposition
_SHORT_INSIDE = ("soll", "ist", "weg", "pos", "cmd", "ref")  # at an end of a longer word only


class Unit(NamedTuple):
    """What a unit measures, and the unit of a column map with the factor to it; no unit where maps have none."""

    of: str
    unit: str
    factor: float = 1.0


# What is measured, the unit of a column map ("" where maps have none), the factor to it: how loggers write it.
_WRITTEN: dict[tuple[str, str, float], str] = {
    ("time", "s", 1.0): "s sec sek secs second seconds sekunden secondes secondi segundos",
    ("time", "ms", 1.0): "ms msec millis",
    ("time", "us", 1.0): "us usec micros",
    ("time", "ns", 1.0): "ns nsec nanos",
    ("time", "min", 1.0): "min",
    ("voltage", "V", 1.0): "V volt volts",
    ("voltage", "V", 1e3): "kV",
    ("voltage", "mV", 1.0): "mV",
    ("current", "A", 1.0): "A amp amps ampere amperes",
    ("current", "mA", 1.0): "mA",
    ("current", "uA", 1.0): "uA",
    ("length", "m", 1.0): "m meter metre",
    ("length", "cm", 1.0): "cm",
    ("length", "cm", 10.0): "dm",
    ("length", "mm", 1.0): "mm millimeter",
    ("length", "mm", 25.4): "in inch inches",
    ("length", "um", 1.0): "um micron microns",
    ("length", "um", 1e-3): "nm",
    ("angle", "deg", 1.0): "deg grad degree degrees",
    ("angle", "rad", 1.0): "rad",
    ("angle", "rad", 1e-3): "mrad",
    ("turns", "rev", 1.0): "rev revs turn turns umdr",
    ("speed", "rpm", 1.0): "rpm 1/min u/min min-1 min^-1 tr/min giri/min rev/min r/min",
    ("speed", "rad/s", 1.0): "rad/s rads rad/sec 1/s",
    ("speed", "deg/s", 1.0): "deg/s dps",
    ("speed", "rev/s", 1.0): "rev/s rps",
    ("force", "N", 1.0): "N newton",
    ("force", "mN", 1.0): "mN",
    ("force", "kN", 1.0): "kN",
    ("force", "lbf", 1.0): "lbf",
    ("linear speed", "", 1.0): "m/s mm/s in/s mm/min m/min cm/s",
    ("torque", "", 1.0): "Nm mNm Ncm",
    ("temperature", "", 1.0): "degC C K degF",
    ("power", "", 1.0): "W kW mW",
    ("mass", "", 1.0): "kg g",
    ("counts", "", 1.0): "counts count cts inc ticks",
    ("another", "", 1.0): "Hz kHz % bar ohm",
}
UNITS = {name: Unit(*unit) for unit, names in _WRITTEN.items() for name in names.split()}
_FOLDED = {name.casefold(): unit for name, unit in UNITS.items() if len(name) > 1}
_SIGNS = str.maketrans({"µ": "u", "μ": "u", "°": "deg", "º": "deg", "⁻": "-", "¹": "1", "·": " ", "Ω": "ohm"})
_BRACKETED = re.compile(r"[\[(<{]\s*([^\])>}]*?)\s*[\])>}]")


class Header(NamedTuple):
    """A header as it is understood: quantities by how well its words say them (0 to 1), its unit, and what is said of it."""

    quantities: dict[str, float]
    unit: Unit | None
    unit_text: str
    commanded: bool
    measured: bool
    deviation: bool


def unit_of(text: str) -> Unit | None:
    """The unit of a text like "mm", "[mA]" or "rad/s"; None where it is none."""
    found = _BRACKETED.fullmatch(text.strip())
    plain = (found[1] if found else text).strip().translate(_SIGNS).strip(". ")
    return UNITS.get(plain) or _FOLDED.get(plain.casefold())


def understood(header: str, told_unit: str = "") -> Header:
    """What the words and the unit of a header say. told_unit: of a units row or the file's own properties."""
    name, unit_text = _split(header)
    if told_unit.strip():
        unit_text = told_unit.strip()
    words = _words(name)
    quantities = {q: share for q, vocabulary in _WORDS.items() if (share := _said(words, vocabulary)) > 0.0}
    quantities = _without_qualifiers(quantities, words)
    unit = unit_of(unit_text) if unit_text else None
    if unit is None and not unit_text:  # a header that is nothing but a unit
        alone = unit_of(header) if len(header.strip()) > 1 or header.strip() in ("A", "V", "N") else None
        if alone is not None and (not quantities or alone.of in quantities):
            unit, unit_text = alone, header.strip()
    small = re.fullmatch(r".*_([van])", header)  # voltage_v, as the contract writes it
    if unit is None and small and UNITS[small[1].upper()].of in quantities:
        unit, unit_text = UNITS[small[1].upper()], small[1].upper()
    return Header(
        quantities, unit, unit_text,
        _said(words, _COMMANDED) > 0.0, _said(words, _MEASURED) > 0.0, _said(words, _DEVIATION) > 0.0,
    )  # fmt: skip


def _without_qualifiers(quantities: dict[str, float], words: list[str]) -> dict[str, float]:
    """Without words that tell another one apart: the current position, the load current, the voltage of the supply."""
    if "supply" in quantities:
        return {"supply": quantities["supply"]}
    main = {q: share for q, share in quantities.items() if q not in ("load", "number")}
    if "current" in words and set(main) - {"current"}:
        main.pop("current", None)
    return main or quantities


def meaning(header: Header) -> str:
    """What a column may be that is none of a log, in words."""
    if header.deviation:
        return "a deviation"
    quantity = next(iter(header.quantities), header.unit.of if header.unit else "")
    if not quantity:
        return ""
    speed = "a commanded speed" if header.commanded else "a measured speed"
    words = {"number": "a number of something", "speed": speed, "linear speed": speed, "another": ""}
    return words.get(quantity, f"{'a commanded ' if header.commanded else ''}{quantity}")


def _split(header: str) -> tuple[str, str]:
    """Name and unit of a header: "Weg [mm]", "U / V", "i_mA", "Strom in A", "pos.um"."""
    bracketed = _BRACKETED.search(header)
    if bracketed and (unit_of(bracketed[1]) or not bracketed[1] or bracketed.end() == len(header.rstrip())):
        return header[: bracketed.start()] + header[bracketed.end() :], bracketed[1]
    for pattern in (r"\s*/\s*", r"\s+in\s+", r",\s*", r"[_.\s-]+"):
        parts = list(re.finditer(pattern, header))
        # the longest tail that is a unit: rad_s is one, and so is s
        for part in parts:
            name, tail = header[: part.start()], header[part.end() :]
            unit = unit_of(tail) or unit_of(re.sub(r"_|\s*per\s*", "/", tail))
            if name.strip() and unit is not None:
                return name, re.sub(r"_|\s*per\s*", "/", tail) if unit_of(tail) is None else tail
    glued = re.fullmatch(r"(.*[a-z])(mA|mV|uA|mm|RPM|Rpm|Volt|Amps|Ms|Sec|Deg|Rad)", header)
    return (glued[1], glued[2].replace("Ms", "ms")) if glued else (header, "")


def _words(name: str) -> list[str]:
    """The words of a name, lower case and without accents: camelCase, underscores and digits part them."""
    plain = name.replace("ß", "ss").replace("ä", "ae").replace("ö", "oe").replace("ü", "ue")
    plain = unicodedata.normalize(
        "NFKD", plain.replace("φ", "phi").replace("θ", "theta").replace("ω", "omega")
    )
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    plain = re.sub(r"([a-z])([A-Z])", r"\1 \2", plain)
    return [word.lower() for word in re.findall(r"[A-Za-z]+", plain)]


def _said(words: list[str], vocabulary: frozenset[str]) -> float:
    """How well words say something: 1 by a whole word, less by one letter or within a longer word."""
    best = 0.0
    for word in words:
        if word in vocabulary:
            best = max(best, 1.0 if len(word) > 2 else 0.5)
            continue
        if word in _WHOLE:
            continue
        inside = [v for v in vocabulary if len(v) >= INSIDE and v in word]
        ends = [
            v
            for v in vocabulary
            if v in _SHORT_INSIDE and len(word) > 4 and (word.startswith(v) or word.endswith(v))
        ]
        best = max(best, 0.8 if inside or ends else 0.0)
    return best


_WORDS = {quantity: frozenset(words.split()) for quantity, words in NAMES.items()}
_WHOLE = frozenset(word for vocabulary in _WORDS.values() for word in vocabulary)
_COMMANDED, _MEASURED, _DEVIATION = (frozenset(text.split()) for text in (COMMANDED, MEASURED, DEVIATION))
