#include "granular/packing_io.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <clocale>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "granular/atomic_file.h"
#include "gtest/gtest.h"
#include "solvers/random.h"

namespace granopt {
namespace {

namespace fs = std::filesystem;

std::uint64_t Bits(double value) {
  std::uint64_t bits;
  std::memcpy(&bits, &value, sizeof(bits));
  return bits;
}

// Everything a file carries is the same, bit by bit.
void ExpectSame(const Packing& a, const Packing& b) {
  ASSERT_EQ(a.dimension(), b.dimension());
  ASSERT_EQ(a.size(), b.size());
  for (int k = 0; k < a.dimension(); ++k) {
    for (int c = 0; c < a.dimension(); ++c) {
      EXPECT_EQ(Bits(a.box.edges()(k, c)), Bits(b.box.edges()(k, c)));
    }
  }
  ASSERT_EQ(a.stiffness.size(), b.stiffness.size());
  for (int i = 0; i < a.size(); ++i) {
    for (int k = 0; k < a.dimension(); ++k) {
      EXPECT_EQ(Bits(a.Position(i, k).hi), Bits(b.Position(i, k).hi)) << i;
      EXPECT_EQ(Bits(a.Position(i, k).lo), Bits(b.Position(i, k).lo)) << i;
    }
    EXPECT_EQ(Bits(a.radii[i]), Bits(b.radii[i])) << i;
    if (a.stiffness.size() > 0) {
      EXPECT_EQ(Bits(a.stiffness[i]), Bits(b.stiffness[i])) << i;
    }
    EXPECT_EQ(a.species.empty() ? "A" : a.species[i],
              b.species.empty() ? "A" : b.species[i]);
  }
  EXPECT_EQ(a.attributes, b.attributes);
}

Packing ExpectParses(const std::string& text) {
  Packing packing;
  std::string error;
  EXPECT_TRUE(ParsePacking(text, "f.xyz", &packing, &error)) << error;
  return packing;
}

void ExpectRoundTrip(const Packing& packing) {
  const std::string text = FormatPacking(packing);
  ExpectSame(packing, ExpectParses(text));
  EXPECT_EQ(FormatPacking(ExpectParses(text)), text);
}

// The one line of error for a text that must be refused.
std::string ErrorOf(const std::string& text) {
  Packing packing;
  packing.attributes["untouched"] = "yes";
  std::string error;
  if (ParsePacking(text, "f.xyz", &packing, &error)) return "no error";
  EXPECT_EQ(error.find('\n'), std::string::npos) << error;
  EXPECT_EQ(packing.attributes.count("untouched"), 1u);
  EXPECT_EQ(packing.size(), 0);
  return error;
}

// Random grains in a sheared cell, with digits in every place.
Packing MakePacking(int dimension, int n) {
  UniformRandom random(7 * dimension + n);
  Packing packing;
  SmallMatrix edges = SmallMatrix::Identity(dimension, dimension) * 1.25;
  edges(0, 1) = 0.1 + 0x1p-52;
  edges(1, 0) = -1.0 / 3.0;
  edges(dimension - 1, dimension - 1) = 0.7;
  packing.box = Box(edges);
  packing.positions.resize(dimension, n);
  packing.radii.resize(n);
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < dimension; ++k) {
      packing.positions(k, i) = 3.0 * random() - 1.0;
    }
    packing.radii[i] = 0.01 + random() / 7.0;
  }
  return packing;
}

constexpr char kHeader[] =
    "Lattice=\"1 0 0 0 1 0 0 0 1\" "
    "Properties=species:S:1:pos:R:3:radius:R:1 pbc=\"T T F\"\n";

// Two discs, with `header` for the comment line if given.
std::string TwoDiscs(const std::string& header = kHeader) {
  return "2\n" + header + "A 0.25 0.5 0 0.125\nB 0.75 0.5 0 0.25\n";
}

// ---- What must come back as it was ------------------------------------------

TEST(PackingIo, RoundTripDiscs) { ExpectRoundTrip(MakePacking(2, 5)); }

TEST(PackingIo, RoundTripSpheres) { ExpectRoundTrip(MakePacking(3, 6)); }

TEST(PackingIo, RoundTripOneGrain) {
  // All z are equal, but pbc tells a sphere from a disc.
  ExpectRoundTrip(MakePacking(2, 1));
  ExpectRoundTrip(MakePacking(3, 1));
}

TEST(PackingIo, RoundTripEverything) {
  for (const int dimension : {2, 3}) {
    Packing packing = MakePacking(dimension, 17);
    UniformRandom random(3);
    packing.positions_low.setZero(dimension, 17);
    packing.stiffness.resize(17);
    for (int i = 0; i < 17; ++i) {
      for (int k = 0; k < dimension; ++k) {
        if (i % 3 == 1) continue;  // some are zero
        const double ulp =
            std::nextafter(std::abs(packing.positions(k, i)), 10.0) -
            std::abs(packing.positions(k, i));
        packing.positions_low(k, i) = 0.49 * ulp * (2.0 * random() - 1.0);
      }
      packing.stiffness[i] = 1.0 / 3.0 + random();
      packing.species.push_back(i % 2 == 0 ? "small" : "B2");
    }
    ExpectRoundTrip(packing);
  }
}

TEST(PackingIo, RoundTripOddNumbers) {
  Packing packing = MakePacking(2, 4);
  packing.positions.col(0) << -0.0, std::numeric_limits<double>::denorm_min();
  packing.positions.col(1) << std::numeric_limits<double>::min(), 0.1;
  packing.positions.col(2) << -1e-310, 1.0 - 0x1p-53;
  packing.radii[0] = std::numeric_limits<double>::denorm_min();
  packing.radii[1] = std::numeric_limits<double>::max();
  ExpectRoundTrip(packing);
  // A low part beside a negative zero does not lose the sign.
  packing.positions_low.setZero(2, 4);
  packing.positions_low(1, 3) = 1e-30;
  ExpectRoundTrip(packing);
}

TEST(PackingIo, RoundTripAttributes) {
  Packing packing = MakePacking(2, 2);
  packing.attributes = {{"alpha", "2.5"},
                        {"seed", "18446744073709551615"},
                        {"note", "left wall, two  blanks\tand a tab"},
                        {"said", "he said \"jam\" and 'stop'"},
                        {"path", "C:\\new\\table"},
                        {"ends", "with a backslash \\"},
                        {"empty", ""},
                        {"lines", "one\ntwo"},
                        {"list", "[1,2,{3}]"},
                        {"equation", "a=b"},
                        {"a key", "with a blank"},
                        {"k\"q", "x\"y"},
                        {"x=y", "="},
                        {"flag", "T"},
                        {"utf8", "\xcf\x86 = 0.84"}};
  ExpectRoundTrip(packing);
}

TEST(PackingIo, LowPartsOfZeroAreNotWritten) {
  Packing packing = MakePacking(2, 3);
  packing.positions_low.setZero(2, 3);
  EXPECT_EQ(FormatPacking(packing).find("pos_lo"), std::string::npos);
  ExpectRoundTrip(packing);
}

TEST(PackingIo, FormatIsStable) {
  Packing packing;
  packing.positions.resize(2, 2);
  packing.positions << 0.25, 0.75, 0.5, 0.1;
  packing.radii.resize(2);
  packing.radii << 0.125, 0.25;
  packing.attributes["alpha"] = "2";
  EXPECT_EQ(FormatPacking(packing),
            "2\n"
            "Lattice=\"1 0 0 0 1 0 0 0 0.5\" "
            "Properties=species:S:1:pos:R:3:radius:R:1 pbc=\"T T F\" alpha=2\n"
            "A 0.25 0.5 0 0.125\n"
            "A 0.75 0.10000000000000001 0 0.25\n");
}

// Installed locales only; the C locale always is.
TEST(PackingIo, DecimalPointInEveryLocale) {
  const Packing packing = MakePacking(2, 3);
  const std::string expected = FormatPacking(packing);
  for (const char* locale : {"de_DE.UTF-8", "fr_FR.UTF-8", "C.UTF-8"}) {
    if (std::setlocale(LC_ALL, locale) == nullptr) continue;
    EXPECT_EQ(FormatPacking(packing), expected) << locale;
    ExpectRoundTrip(packing);
  }
  std::setlocale(LC_ALL, "C");
}

// ---- What others write ------------------------------------------------------

TEST(PackingIo, ReadsColumnsInAnyOrder) {
  const Packing packing = ExpectParses(
      "3\n"
      "Lattice=\"2.0 0.0 0.0 0.5 1.0 0.0 0.0 0.0 0.4\" Origin=\"0 0 0\" "
      "Properties=id:I:1:radius:R:1:forces:R:3:selected:L:1:pos:R:3:species:S:"
      "1:"
      "stiffness:R:1 Time=12.5 \"a b\"='c' free_energy=-1e-3 pbc=\"1 1 0\"\n"
      "1 0.1  9 9 9 T  0.5 0.25 0.2  Si 2\n"
      "2 .2   8 8 8 F  +1.5 -7.5e-1 0.2  C 3.0\n"
      "3 2e-1 7 7 7 T  1. 0.5 2e-1  Si 4\n");
  ASSERT_EQ(packing.dimension(), 2);
  ASSERT_EQ(packing.size(), 3);
  EXPECT_EQ(packing.box.edges()(0, 0), 2.0);
  EXPECT_EQ(packing.box.edges()(0, 1), 0.5);
  EXPECT_EQ(packing.box.edges()(1, 0), 0.0);
  EXPECT_EQ(packing.box.edges()(1, 1), 1.0);
  EXPECT_EQ(packing.radii, Eigen::Vector3d(0.1, 0.2, 0.2));
  EXPECT_EQ(packing.stiffness, Eigen::Vector3d(2, 3, 4));
  Eigen::MatrixXd expected(2, 3);
  expected << 0.5, 1.5, 1.0, 0.25, -0.75, 0.5;
  EXPECT_EQ(packing.positions, expected);
  EXPECT_EQ(packing.positions_low.size(), 0);
  EXPECT_EQ(packing.species, (std::vector<std::string>{"Si", "C", "Si"}));
  EXPECT_EQ(packing.attributes,
            (std::map<std::string, std::string>{{"Origin", "0 0 0"},
                                                {"Time", "12.5"},
                                                {"a b", "'c'"},
                                                {"free_energy", "-1e-3"}}));
}

TEST(PackingIo, ReadsEscapedQuotes) {
  const Packing packing = ExpectParses(TwoDiscs(
      "Lattice=\"1 0 0 0 1 0 0 0 1\" info=\"_JSON {\\\"a\\\": [1, 2]}\" "
      "path=\"C:\\\\x\" two=\"a\\nb\" bare=a\\b "
      "Properties=species:S:1:pos:R:3:radius:R:1\n"));
  EXPECT_EQ(packing.attributes.at("info"), "_JSON {\"a\": [1, 2]}");
  EXPECT_EQ(packing.attributes.at("path"), "C:\\x");
  EXPECT_EQ(packing.attributes.at("two"), "a\nb");
  EXPECT_EQ(packing.attributes.at("bare"), "a\\b");
}

TEST(PackingIo, ReadsWindowsLineEnds) {
  std::string text = TwoDiscs(std::string("flag ") + kHeader);
  const Packing expected = ExpectParses(text);
  for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos;
       at += 2) {
    text.insert(at, 1, '\r');
  }
  ExpectSame(ExpectParses(text), expected);
  EXPECT_EQ(expected.attributes.at("flag"), "T");
  // Messages do not show the carriage return.
  EXPECT_EQ(ErrorOf("two\r\n"),
            "f.xyz:1: the number of grains must be a positive integer, not "
            "'two'");
}

TEST(PackingIo, ReadsBareFlags) {
  const Packing packing = ExpectParses(
      TwoDiscs("relaxed " + std::string("Lattice=\"1 0 0 0 1 0 0 0 1\" ") +
               "Properties=species:S:1:pos:R:3:radius:R:1 empty= "
               "pbc=\"T T F\" \"two words\" last\n"));
  EXPECT_EQ(
      packing.attributes,
      (std::map<std::string, std::string>{
          {"relaxed", "T"}, {"empty", ""}, {"two words", "T"}, {"last", "T"}}));
}

TEST(PackingIo, DimensionWithoutPbc) {
  const std::string header =
      "Lattice=\"1 0 0 0 1 0 0 0 1\" Properties=pos:R:3:radius:R:1\n";
  EXPECT_EQ(
      ExpectParses("2\n" + header + ".1 .2 .5 .1\n.5 .6 .5 .1\n").dimension(),
      2);
  const Packing spheres =
      ExpectParses("2\n" + header + ".1 .2 .5 .1\n.5 .6 .25 .1\n");
  EXPECT_EQ(spheres.dimension(), 3);
  EXPECT_EQ(spheres.positions(2, 1), 0.25);
  EXPECT_TRUE(spheres.species.empty());
  EXPECT_TRUE(spheres.attributes.empty());
}

TEST(PackingIo, BlankLinesAtTheEndAndNoLastLineBreak) {
  const Packing expected = ExpectParses(TwoDiscs());
  ExpectSame(ExpectParses(TwoDiscs() + "\n  \n\t\n"), expected);
  std::string text = TwoDiscs();
  text.pop_back();
  ExpectSame(ExpectParses(text), expected);
}

TEST(PackingIo, LargeLowPartsAreCarriedOver) {
  const Packing packing = ExpectParses(
      "1\nLattice=\"1 0 0 0 1 0 0 0 1\" "
      "Properties=pos:R:3:radius:R:1:pos_lo:R:3\n.5 .5 0 .1 .125 1e-40 0\n");
  EXPECT_EQ(packing.Position(0, 0).hi, 0.625);
  EXPECT_EQ(packing.Position(0, 0).lo, 0.0);
  EXPECT_EQ(packing.Position(0, 1).lo, 1e-40);
}

TEST(PackingIo, BytesBeyondAsciiInNames) {
  // Names are bytes: what is not UTF-8 either comes back as it was.
  Packing packing = MakePacking(2, 2);
  packing.species = {"gr\xfc\xdf", "\xe7\x8f\xa0"};
  packing.attributes["author"] = "\xff\xfe caf\xe9";
  ExpectRoundTrip(packing);
}

// ---- What must be refused ---------------------------------------------------

TEST(PackingIoErrors, EmptyFile) {
  EXPECT_EQ(ErrorOf(""), "f.xyz:1: the file is empty");
}

TEST(PackingIoErrors, Count) {
  const std::string no =
      "f.xyz:1: the number of grains must be a positive integer, not ";
  EXPECT_EQ(ErrorOf("\n"), no + "''");
  EXPECT_EQ(ErrorOf("two\n"), no + "'two'");
  EXPECT_EQ(ErrorOf("2 2\n"), no + "'2 2'");
  EXPECT_EQ(ErrorOf("2.5\n"), no + "'2.5'");
  EXPECT_EQ(ErrorOf("0x2\n"), no + "'0x2'");
  EXPECT_EQ(ErrorOf("-3\n"), no + "'-3'");
  EXPECT_EQ(ErrorOf("99999999999999999999\n"), no + "'99999999999999999999'");
  EXPECT_EQ(ErrorOf("\xef\xbb\xbf" + TwoDiscs()), no + "'?\?\?2'");
}

TEST(PackingIoErrors, ZeroGrains) {
  EXPECT_EQ(
      ErrorOf(std::string("0\n") + kHeader),
      "f.xyz:1: the number of grains must be a positive integer, not '0'");
}

TEST(PackingIoErrors, AbsurdCountIsRefusedBeforeMemoryIsTaken) {
  EXPECT_EQ(ErrorOf("1000000000000\n" + TwoDiscs().substr(2)),
            "f.xyz:1: 1000000000000 grains are declared, but only 37 bytes of "
            "rows follow");
  EXPECT_EQ(ErrorOf("9223372036854775807\n" + TwoDiscs().substr(2)),
            "f.xyz:1: 9223372036854775807 grains are declared, but only 37 "
            "bytes of rows follow");
  EXPECT_EQ(ErrorOf("1e12\n" + TwoDiscs().substr(2)),
            "f.xyz:1: the number of grains must be a positive integer, not "
            "'1e12'");
}

TEST(PackingIoErrors, TruncatedFile) {
  EXPECT_EQ(ErrorOf("2\n"), "f.xyz:1: the file ends before the comment line");
  EXPECT_EQ(ErrorOf("3\n" + TwoDiscs().substr(2)),
            "f.xyz:4: the file ends after 2 of 3 rows");
  const std::string text = TwoDiscs();
  EXPECT_EQ(ErrorOf(text.substr(0, text.size() - 6)),
            "f.xyz:4: row has 4 columns, not 5");
  // Wherever the file is cut, the reader notices, except within the last
  // number.
  for (std::size_t size = 0; size < text.size() - 5; ++size) {
    EXPECT_NE(ErrorOf(text.substr(0, size)), "no error") << size;
  }
}

TEST(PackingIoErrors, HeaderKeysMissing) {
  EXPECT_EQ(ErrorOf("1\n\nA 0 0 0 1\n"), "f.xyz:2: Lattice=\"...\" is missing");
  EXPECT_EQ(ErrorOf("1\nLattice=\"1 0 0 0 1 0 0 0 1\"\nA 0 0 0 1\n"),
            "f.xyz:2: Properties=... is missing");
}

TEST(PackingIoErrors, Lattice) {
  const auto error = [](const std::string& lattice) {
    return ErrorOf(TwoDiscs("Lattice=\"" + lattice +
                            "\" Properties=species:S:1:pos:R:3:radius:R:1\n"));
  };
  EXPECT_EQ(error("1 0 0 0 1 0 0 0"), "f.xyz:2: Lattice has 8 numbers, not 9");
  EXPECT_EQ(error("1 0 0 0 1 0 0 0 1 0"),
            "f.xyz:2: Lattice has 10 numbers, not 9");
  EXPECT_EQ(error("1 0 0 0 one 0 0 0 1"),
            "f.xyz:2: Lattice: 'one' is not a finite number");
  EXPECT_EQ(error("1 0 0 0 nan 0 0 0 1"),
            "f.xyz:2: Lattice: 'nan' is not a finite number");
  EXPECT_EQ(error("1 0 0 0 1e999 0 0 0 1"),
            "f.xyz:2: Lattice: '1e999' is not a finite number");
  EXPECT_EQ(error("1 0 0 0 +-1 0 0 0 1"),
            "f.xyz:2: Lattice: '+-1' is not a finite number");
}

TEST(PackingIoErrors, SingularCell) {
  const std::string singular = "f.xyz:2: Lattice: the cell is singular";
  const auto error = [](const std::string& lattice, const std::string& pbc) {
    return ErrorOf(TwoDiscs(
        "Lattice=\"" + lattice +
        "\" Properties=species:S:1:pos:R:3:radius:R:1 pbc=" + pbc + "\n"));
  };
  const std::string discs = "\"T T F\"", spheres = "\"T T T\"";
  EXPECT_EQ(error("0 0 0 0 0 0 0 0 0", discs), singular);
  EXPECT_EQ(error("1 2 0 2 4 0 0 0 1", discs), singular);
  EXPECT_EQ(error("1 0 0 1 1e-13 0 0 0 1", discs), singular);
  EXPECT_EQ(error("1 0 0 0 1 0 1 1 0", spheres), singular);
  // Neither volume nor edges may leave the range of double, nor image numbers
  // that of int.
  EXPECT_EQ(error("1e200 0 0 0 1e200 0 0 0 1", discs), singular);
  EXPECT_EQ(error("1e-200 0 0 0 1e-200 0 0 0 1", discs), singular);
  EXPECT_EQ(error("1 0 0 0 1e-9 0 0 0 1", discs), singular);
  EXPECT_EQ(error("1 0 0 1e10 1 0 0 0 1", discs), singular);
  EXPECT_EQ(error("1 0 0.5 0 1 0 0 0 1", discs),
            "f.xyz:2: the first two edges of a cell of discs must lie in the "
            "plane");
}

TEST(PackingIoErrors, NotPeriodic) {
  const auto error = [](const std::string& pbc) {
    return ErrorOf(
        TwoDiscs("Lattice=\"1 0 0 0 1 0 0 0 1\" "
                 "Properties=species:S:1:pos:R:3:radius:R:1 pbc=" +
                 pbc + "\n"));
  };
  const std::string must = " must be \"T T F\" (discs) or \"T T T\" (spheres)";
  EXPECT_EQ(error("\"F F F\""), "f.xyz:2: pbc='F F F'" + must);
  EXPECT_EQ(error("\"T F F\""), "f.xyz:2: pbc='T F F'" + must);
  EXPECT_EQ(error("\"F T T\""), "f.xyz:2: pbc='F T T'" + must);
  EXPECT_EQ(error("\"T T\""), "f.xyz:2: pbc='T T'" + must);
  EXPECT_EQ(error("\"T T T T\""), "f.xyz:2: pbc='T T T T'" + must);
  EXPECT_EQ(error("T"), "f.xyz:2: pbc='T'" + must);
  EXPECT_EQ(error("\"2 1 1\""), "f.xyz:2: pbc='2 1 1'" + must);
}

TEST(PackingIoErrors, Properties) {
  const auto error = [](const std::string& properties) {
    return ErrorOf(TwoDiscs(
        "Lattice=\"1 0 0 0 1 0 0 0 1\" Properties=" + properties + "\n"));
  };
  EXPECT_EQ(error("species:S:1:pos:R:3:radius:R"),
            "f.xyz:2: Properties='species:S:1:pos:R:3:radius:R' is not a list "
            "of name:type:columns");
  EXPECT_EQ(error("\"\""),
            "f.xyz:2: Properties='' is not a list of name:type:columns");
  EXPECT_EQ(error("species:S:1:position:R:3:radius:R:1"),
            "f.xyz:2: Properties has no column pos:R:3");
  EXPECT_EQ(error("species:S:1:pos:R:3:diameter:R:1"),
            "f.xyz:2: Properties has no column radius:R:1");
  EXPECT_EQ(error("species:S:1:pos:R:2:radius:R:1"),
            "f.xyz:2: Properties: 'pos:R:2' must be pos:R:3");
  EXPECT_EQ(error("species:S:1:pos:I:3:radius:R:1"),
            "f.xyz:2: Properties: 'pos:I:3' must be pos:R:3");
  EXPECT_EQ(error("species:I:1:pos:R:3:radius:R:1"),
            "f.xyz:2: Properties: 'species:I:1' must be species:S:1");
  EXPECT_EQ(error("pos:R:3:radius:R:2"),
            "f.xyz:2: Properties: 'radius:R:2' must be radius:R:1");
  EXPECT_EQ(error("pos:R:3:radius:R:1:pos_lo:R:1"),
            "f.xyz:2: Properties: 'pos_lo:R:1' must be pos_lo:R:3");
  EXPECT_EQ(error("pos:R:3:radius:R:1:stiffness:S:1"),
            "f.xyz:2: Properties: 'stiffness:S:1' must be stiffness:R:1");
  EXPECT_EQ(error("species:X:1:pos:R:3:radius:R:1"),
            "f.xyz:2: Properties: 'species':'X':'1' is not name:type(S, R, I, "
            "L):columns");
  EXPECT_EQ(
      error("species:S:one:pos:R:3:radius:R:1"),
      "f.xyz:2: Properties: 'species':'S':'one' is not name:type(S, R, I, "
      "L):columns");
  EXPECT_EQ(error("pos:R:3:radius:R:1:id:I:1000000000"),
            "f.xyz:2: Properties: 'id':'I':'1000000000' is not name:type(S, R, "
            "I, L):columns");
  EXPECT_EQ(error("pos:R:3:radius:R:1:pos:R:3"),
            "f.xyz:2: Properties: 'pos' is given twice");
}

TEST(PackingIoErrors, DuplicateKeys) {
  EXPECT_EQ(ErrorOf(TwoDiscs(std::string("a=1 b=2 a=3 ") + kHeader)),
            "f.xyz:2: key 'a' is given twice");
  EXPECT_EQ(ErrorOf(TwoDiscs(std::string("pbc=\"T T F\" ") + kHeader)),
            "f.xyz:2: key 'pbc' is given twice");
}

TEST(PackingIoErrors, Quotes) {
  EXPECT_EQ(ErrorOf("1\nLattice=\"1 0 0 0 1 0 0 0 1\nA 0 0 0 1\n"),
            "f.xyz:2: the quote of 'Lattice' is not closed");
  EXPECT_EQ(ErrorOf("1\n\"Lattice=1\nA 0 0 0 1\n"),
            "f.xyz:2: a quote is not closed");
  EXPECT_EQ(ErrorOf("1\nnote=\"ends in \\\"\nA 0 0 0 1\n"),
            "f.xyz:2: the quote of 'note' is not closed");
  EXPECT_EQ(ErrorOf("1\nnote=\"ends in \\\nA 0 0 0 1\n"),
            "f.xyz:2: the quote of 'note' is not closed");
  EXPECT_EQ(ErrorOf("1\n=5\nA 0 0 0 1\n"), "f.xyz:2: a value without a key");
  EXPECT_EQ(ErrorOf("1\n\"\"=5\nA 0 0 0 1\n"),
            "f.xyz:2: a value without a key");
}

TEST(PackingIoErrors, RowOfWrongLength) {
  EXPECT_EQ(ErrorOf(std::string("2\n") + kHeader + "A 0 0 0 1\nB 0 0 0 1 7\n"),
            "f.xyz:4: row has 6 columns, not 5");
  EXPECT_EQ(ErrorOf(std::string("2\n") + kHeader + "A 0 0 0 1\n\nB 0 0 0 1\n"),
            "f.xyz:4: row has 0 columns, not 5");
}

TEST(PackingIoErrors, NotFinite) {
  const auto error = [](const std::string& row) {
    return ErrorOf(std::string("2\n") + kHeader + "A 0.5 0.5 0 0.1\n" + row +
                   "\n");
  };
  EXPECT_EQ(error("A nan 0 0 0.1"),
            "f.xyz:4: pos = 'nan' is not a finite number");
  EXPECT_EQ(error("A 0 inf 0 0.1"),
            "f.xyz:4: pos = 'inf' is not a finite number");
  EXPECT_EQ(error("A 0 0 -Infinity 0.1"),
            "f.xyz:4: pos = '-Infinity' is not a finite number");
  EXPECT_EQ(error("A 0 1e400 0 0.1"),
            "f.xyz:4: pos = '1e400' is not a finite number");
  EXPECT_EQ(error("A 0 0 0 NaN"),
            "f.xyz:4: radius = 'NaN' is not a finite number");
  EXPECT_EQ(error("A 0.1x 0 0 1"),
            "f.xyz:4: pos = '0.1x' is not a finite number");
  EXPECT_EQ(error("A 0,1 0 0 1"),
            "f.xyz:4: pos = '0,1' is not a finite number");
  EXPECT_EQ(error("A 0x1p-3 0 0 1"),
            "f.xyz:4: pos = '0x1p-3' is not a finite number");
  EXPECT_EQ(error("A " + std::string(60, '1') + "x 0 0 1"),
            "f.xyz:4: pos = '" + std::string(40, '1') +
                "...' is not a finite number");
}

TEST(PackingIoErrors, BytesThatAreNotUtf8) {
  EXPECT_EQ(ErrorOf(std::string("1\n") + kHeader + "A \xff\xfe\x80 0 0 1\n"),
            "f.xyz:3: pos = '?\?\?' is not a finite number");
  const std::string nul("A 0\0 0 0 1\n", 11);
  EXPECT_EQ(ErrorOf(std::string("1\n") + kHeader + nul),
            "f.xyz:3: pos = '0?' is not a finite number");
  EXPECT_EQ(ErrorOf("\x89PNG\r\n\x1a\n"),
            "f.xyz:1: the number of grains must be a positive integer, not "
            "'?PNG'");
}

TEST(PackingIoErrors, RadiusAndStiffnessNotPositive) {
  const auto error = [](const std::string& radius, const std::string& k) {
    return ErrorOf(
        "1\nLattice=\"1 0 0 0 1 0 0 0 1\" "
        "Properties=radius:R:1:pos:R:3:stiffness:R:1\n" +
        radius + " 0 0 0 " + k + "\n");
  };
  EXPECT_EQ(error("0", "1"), "f.xyz:3: radius = '0' must be positive");
  EXPECT_EQ(error("-0.5", "1"), "f.xyz:3: radius = '-0.5' must be positive");
  EXPECT_EQ(error("1", "0.0"), "f.xyz:3: stiffness = '0.0' must be positive");
  EXPECT_EQ(error("1", "-2"), "f.xyz:3: stiffness = '-2' must be positive");
  EXPECT_EQ(error("1", "inf"),
            "f.xyz:3: stiffness = 'inf' is not a finite number");
}

TEST(PackingIoErrors, LowPart) {
  const std::string header =
      "1\nLattice=\"1 0 0 0 1 0 0 0 1\" "
      "Properties=pos:R:3:radius:R:1:pos_lo:R:3\n";
  EXPECT_EQ(ErrorOf(header + "0 0 0 1 0 nan 0\n"),
            "f.xyz:3: pos_lo = 'nan' is not a finite number");
}

TEST(PackingIoErrors, FarOutsideTheCell) {
  EXPECT_EQ(
      ErrorOf(std::string("2\n") + kHeader + "A 0 0 0 1\nA 0 2e6 0 0.1\n"),
      "f.xyz:2: grain 1: position in cells = 2000000 is far outside");
  // Far along a short edge, not beyond 1e6 times the longest.
  EXPECT_EQ(ErrorOf("1\nLattice=\"1 0 0 0 5.960464477539063e-08 0 0 0 1\" "
                    "Properties=pos:R:3:radius:R:1\n0 0.5 0 1\n"),
            "f.xyz:2: grain 0: position in cells = 8388608 is far outside");
}

TEST(PackingIoErrors, HeightsDiffer) {
  EXPECT_EQ(
      ErrorOf(std::string("2\n") + kHeader + "A 0 0 0.5 0.1\nA 0 0 0.25 0.1\n"),
      "f.xyz:4: z = '0.25' differs from the first grain's, but pbc says "
      "\"T T F\"");
}

TEST(PackingIoErrors, SecondFrame) {
  EXPECT_EQ(ErrorOf(TwoDiscs() + TwoDiscs()),
            "f.xyz:5: more rows than the 2 declared, or a second frame: '2'");
  EXPECT_EQ(ErrorOf(TwoDiscs() + "\nA 0 0 0 1\n"),
            "f.xyz:6: more rows than the 2 declared, or a second frame: 'A 0 0 "
            "0 1'");
}

// ---- Files ------------------------------------------------------------------

class PackingIoFiles : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "granopt_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    directory_ = name;
  }
  void TearDown() override {
    chmod(directory_.c_str(), 0755);
    fs::remove_all(directory_);
  }

  std::string Path(const std::string& name) const {
    return (directory_ / name).string();
  }
  // Names in the directory, sorted.
  std::vector<std::string> Names() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(directory_)) {
      names.push_back(entry.path().filename().string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }
  static std::string Content(const std::string& path) {
    std::string content, error;
    EXPECT_TRUE(ReadFile(path, &content, &error)) << error;
    return content;
  }
  // The error of a write that must fail.
  static std::string WriteError(const std::string& path,
                                const Packing& packing) {
    std::string error;
    EXPECT_FALSE(WritePacking(path, packing, &error));
    EXPECT_EQ(error.find('\n'), std::string::npos);
    return error;
  }

  using Strings = std::vector<std::string>;
  fs::path directory_;
};

// Writes as a user without privileges while it lives, if the test runs as root.
class Unprivileged {
 public:
  Unprivileged() : was_root_(geteuid() == 0) {
    if (was_root_ && seteuid(65534) != 0) std::abort();
  }
  ~Unprivileged() {
    if (was_root_ && seteuid(0) != 0) std::abort();
  }

 private:
  const bool was_root_;
};

// Files may grow to `bytes` while it lives, as on a disk that is full.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &limit_);
    rlimit small = limit_;
    small.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &small);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &limit_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  void (*handler_)(int);
  rlimit limit_;
};

TEST_F(PackingIoFiles, WritesAndReads) {
  const Packing packing = MakePacking(3, 50);
  std::string error;
  ASSERT_TRUE(WritePacking(Path("p.xyz"), packing, &error)) << error;
  EXPECT_EQ(Names(), Strings{"p.xyz"});
  EXPECT_EQ(Content(Path("p.xyz")), FormatPacking(packing));
  Packing read;
  ASSERT_TRUE(ReadPacking(Path("p.xyz"), &read, &error)) << error;
  ExpectSame(packing, read);
  // Again, over the first.
  const Packing other = MakePacking(2, 3);
  ASSERT_TRUE(WritePacking(Path("p.xyz"), other, &error)) << error;
  EXPECT_EQ(Names(), Strings{"p.xyz"});
  EXPECT_EQ(Content(Path("p.xyz")), FormatPacking(other));
}

TEST_F(PackingIoFiles, ErrorsOfReadingNameTheFile) {
  Packing packing;
  std::string error;
  EXPECT_FALSE(ReadPacking(Path("none.xyz"), &packing, &error));
  EXPECT_EQ(error,
            Path("none.xyz") + ": cannot read: No such file or directory");
  EXPECT_FALSE(ReadPacking(directory_.string(), &packing, &error));
  EXPECT_EQ(error, directory_.string() + ": cannot read: Is a directory");
  std::ofstream(Path("bad.xyz")) << "2\n" << kHeader << "A 0 0 0 -1\n";
  EXPECT_FALSE(ReadPacking(Path("bad.xyz"), &packing, &error));
  EXPECT_EQ(error, Path("bad.xyz") + ":3: radius = '-1' must be positive");
}

TEST_F(PackingIoFiles, DirectoryThatDoesNotExist) {
  EXPECT_EQ(WriteError(Path("none/p.xyz"), MakePacking(2, 2)),
            Path("none/p.xyz") + ": cannot write: No such file or directory");
  EXPECT_EQ(Names(), Strings{});
}

TEST_F(PackingIoFiles, ParentIsAFile) {
  std::ofstream(Path("file")) << "here";
  EXPECT_EQ(WriteError(Path("file/p.xyz"), MakePacking(2, 2)),
            Path("file/p.xyz") + ": cannot write: Not a directory");
  EXPECT_EQ(Names(), Strings{"file"});
  EXPECT_EQ(Content(Path("file")), "here");
}

TEST_F(PackingIoFiles, UnwritableDirectory) {
  std::ofstream(Path("p.xyz")) << "before";
  ASSERT_EQ(chmod(directory_.c_str(), 0555), 0);
  {
    const Unprivileged unprivileged;
    EXPECT_EQ(WriteError(Path("p.xyz"), MakePacking(2, 2)),
              Path("p.xyz") + ": cannot write: Permission denied");
    EXPECT_EQ(WriteError(Path("new.xyz"), MakePacking(2, 2)),
              Path("new.xyz") + ": cannot write: Permission denied");
  }
  EXPECT_EQ(Names(), Strings{"p.xyz"});
  EXPECT_EQ(Content(Path("p.xyz")), "before");
}

TEST_F(PackingIoFiles, PathIsADirectory) {
  fs::create_directory(Path("p.xyz"));
  EXPECT_EQ(WriteError(Path("p.xyz"), MakePacking(2, 2)),
            Path("p.xyz") + ": cannot write: not a regular file");
  EXPECT_EQ(Names(), Strings{"p.xyz"});
  EXPECT_TRUE(fs::is_empty(Path("p.xyz")));
}

TEST_F(PackingIoFiles, PathIsNotAFile) {
  // As /dev/null is not: it must not be replaced.
  ASSERT_EQ(mkfifo(Path("pipe").c_str(), 0644), 0);
  EXPECT_EQ(WriteError(Path("pipe"), MakePacking(2, 2)),
            Path("pipe") + ": cannot write: not a regular file");
  EXPECT_TRUE(fs::is_fifo(Path("pipe")));
  EXPECT_EQ(Names(), Strings{"pipe"});
}

TEST_F(PackingIoFiles, DiskFull) {
  std::ofstream(Path("p.xyz")) << "before";
  {
    const FullDisk full(4096);
    EXPECT_EQ(WriteError(Path("p.xyz"), MakePacking(3, 500)),
              Path("p.xyz") + ": cannot write: " + std::strerror(EFBIG));
    EXPECT_EQ(WriteError(Path("new.xyz"), MakePacking(3, 500)),
              Path("new.xyz") + ": cannot write: " + std::strerror(EFBIG));
  }
  EXPECT_EQ(Names(), Strings{"p.xyz"});
  EXPECT_EQ(Content(Path("p.xyz")), "before");
}

TEST_F(PackingIoFiles, WhatCannotBeReadIsNotWritten) {
  std::ofstream(Path("p.xyz")) << "before";
  const auto error = [this](void (*spoil)(Packing*)) {
    Packing packing = MakePacking(2, 3);
    packing.species = {"A", "B", "A"};
    spoil(&packing);
    return WriteError(Path("p.xyz"), packing);
  };
  const std::string not_written = Path("p.xyz") + ": not written: ";
  EXPECT_EQ(error([](Packing* p) { *p = Packing(); }),
            not_written + "the packing has no grains");
  EXPECT_EQ(error([](Packing* p) {
              p->positions(1, 2) = std::numeric_limits<double>::quiet_NaN();
            }),
            not_written + "grain 2: position = nan is not finite");
  EXPECT_EQ(error([](Packing* p) { p->radii[1] = 0.0; }),
            not_written + "grain 1: radius = 0 must be positive");
  EXPECT_EQ(error([](Packing* p) { p->species[1] = "two words"; }),
            not_written + "grain 1: species = 'two words' must be one word");
  EXPECT_EQ(error([](Packing* p) { p->species[2] = ""; }),
            not_written + "grain 2: species = '' must be one word");
  EXPECT_EQ(error([](Packing* p) { p->attributes["pbc"] = "T T T"; }),
            not_written + "an attribute cannot be named 'pbc'");
  EXPECT_EQ(error([](Packing* p) { p->attributes[""] = "1"; }),
            not_written + "an attribute cannot be named ''");
  EXPECT_EQ(Names(), Strings{"p.xyz"});
  EXPECT_EQ(Content(Path("p.xyz")), "before");
}

}  // namespace
}  // namespace granopt
