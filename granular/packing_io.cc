#include "granular/packing_io.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include "granular/atomic_file.h"
#include "solvers/format.h"

namespace granopt {
namespace {

// Longer values are cut in messages.
std::string Quoted(std::string_view value) {
  constexpr std::size_t kMost = 40;
  std::string text = "'";
  for (const char c : value.substr(0, kMost)) {
    text += c >= 32 && c < 127 ? c : '?';
  }
  return text + (value.size() > kMost ? "...'" : "'");
}

bool IsSpace(char c) { return c == ' ' || c == '\t' || c == '\r'; }

// A finite number that fills all of `token`.
bool ParseReal(std::string_view token, double* value) {
  if (token.size() > 1 && token[0] == '+' && token[1] != '-') {
    token.remove_prefix(1);
  }
  const char* end = token.data() + token.size();
  const auto result = std::from_chars(token.data(), end, *value);
  return result.ec == std::errc() && result.ptr == end && std::isfinite(*value);
}

bool ParseInteger(std::string_view token, long long* value) {
  const char* end = token.data() + token.size();
  const auto result = std::from_chars(token.data(), end, *value);
  return result.ec == std::errc() && result.ptr == end;
}

// Splits at blanks.
void Tokens(std::string_view line, std::vector<std::string_view>* tokens) {
  tokens->clear();
  std::size_t at = 0;
  while (at < line.size()) {
    while (at < line.size() && IsSpace(line[at])) ++at;
    const std::size_t start = at;
    while (at < line.size() && !IsSpace(line[at])) ++at;
    if (at > start) tokens->push_back(line.substr(start, at - start));
  }
}

struct Column {
  std::string name;
  char type;
  int first;
  int count;
};

class Parser {
 public:
  Parser(const std::string& text,
         const std::string& name,
         FrameExtras* extras = nullptr)
      : text_(text), name_(name), extras_(extras) {}

  bool Parse(Packing* packing, std::string* error) {
    if (Frame(packing)) return true;
    *error = error_;
    return false;
  }

 private:
  bool Fail(const std::string& what) {
    error_ = name_ + ":" + std::to_string(line_number_) + ": " + what;
    return false;
  }

  bool NextLine(std::string_view* line) {
    if (at_ >= text_.size()) return false;
    ++line_number_;
    const std::size_t end = text_.find('\n', at_);
    const std::size_t stop = end == std::string::npos ? text_.size() : end;
    *line = std::string_view(text_).substr(at_, stop - at_);
    if (!line->empty() && line->back() == '\r') line->remove_suffix(1);
    at_ = end == std::string::npos ? text_.size() : end + 1;
    return true;
  }

  // key=value, key="value with blanks", "quoted key"=value, or a bare flag.
  // Inside quotes a backslash stands before a quote or a backslash that is
  // meant, and \n is a line break.
  bool Attributes(std::string_view line,
                  std::map<std::string, std::string>* attributes) {
    std::size_t at = 0;
    const auto word = [&](bool is_key, std::string* out) {
      out->clear();
      if (at < line.size() && line[at] == '"') {
        for (++at; at < line.size() && line[at] != '"'; ++at) {
          const bool escaped = line[at] == '\\' && at + 1 < line.size();
          if (escaped) ++at;
          *out += escaped && line[at] == 'n' ? '\n' : line[at];
        }
        if (at == line.size()) return false;
        ++at;
        return true;
      }
      while (at < line.size() && !IsSpace(line[at]) &&
             !(is_key && line[at] == '=')) {
        *out += line[at++];
      }
      return true;
    };
    while (true) {
      while (at < line.size() && IsSpace(line[at])) ++at;
      if (at >= line.size()) return true;
      std::string key, value = "T";
      if (!word(true, &key)) return Fail("a quote is not closed");
      if (at < line.size() && line[at] == '=') {
        ++at;
        if (!word(false, &value)) {
          return Fail("the quote of " + Quoted(key) + " is not closed");
        }
      }
      if (key.empty()) return Fail("a value without a key");
      if (!attributes->emplace(key, value).second) {
        return Fail("key " + Quoted(key) + " is given twice");
      }
    }
  }

  bool Columns(const std::string& properties) {
    std::vector<std::string_view> fields;
    std::string_view rest = properties;
    while (true) {
      const std::size_t colon = rest.find(':');
      fields.push_back(rest.substr(0, colon));
      if (colon == std::string_view::npos) break;
      rest.remove_prefix(colon + 1);
    }
    if (fields.size() % 3 != 0) {
      return Fail("Properties=" + Quoted(properties) +
                  " is not a list of name:type:columns");
    }
    for (std::size_t f = 0; f < fields.size(); f += 3) {
      long long count;
      const bool known_type = fields[f + 1].size() == 1 &&
                              std::string_view("SRIL").find(fields[f + 1]) !=
                                  std::string_view::npos;
      if (fields[f].empty() || !known_type ||
          !ParseInteger(fields[f + 2], &count) || count < 1 || count > 64 ||
          total_ + count > 1024) {
        return Fail("Properties: " + Quoted(fields[f]) + ":" +
                    Quoted(fields[f + 1]) + ":" + Quoted(fields[f + 2]) +
                    " is not name:type(S, R, I, L):columns");
      }
      for (const Column& other : columns_) {
        if (other.name == fields[f]) {
          return Fail("Properties: " + Quoted(fields[f]) + " is given twice");
        }
      }
      columns_.push_back({std::string(fields[f]),
                          fields[f + 1][0],
                          total_,
                          static_cast<int>(count)});
      total_ += static_cast<int>(count);
    }
    return true;
  }

  bool Frame(Packing* packing) {
    if (!Count() || !Header() || !FitsTheText() || !Rows() || !Cell()) {
      return false;
    }
    if (low_ != nullptr) CarryOver();
    std::string problem;
    if (!result_.IsValid(&problem)) return Fail(problem);
    *packing = std::move(result_);
    return true;
  }

  bool Count() {
    std::string_view line;
    if (!NextLine(&line)) {
      line_number_ = 1;
      return Fail("the file is empty");
    }
    Tokens(line, &tokens_);
    return (tokens_.size() == 1 && ParseInteger(tokens_[0], &count_) &&
            count_ >= 1) ||
           Fail("the number of grains must be a positive integer, not " +
                Quoted(line));
  }

  // Removes an attribute that the format itself knows.
  bool Take(const char* key, std::string* value) {
    const auto found = result_.attributes.find(key);
    if (found == result_.attributes.end()) return false;
    *value = found->second;
    result_.attributes.erase(found);
    return true;
  }

  bool Header() {
    std::string_view line;
    if (!NextLine(&line)) return Fail("the file ends before the comment line");
    header_line_ = line_number_;
    if (!Attributes(line, &result_.attributes)) return false;
    std::string text;
    if (!Take("Lattice", &text)) return Fail("Lattice=\"...\" is missing");
    Tokens(text, &tokens_);
    if (tokens_.size() != 9) {
      return Fail("Lattice has " + std::to_string(tokens_.size()) +
                  " numbers, not 9");
    }
    for (int k = 0; k < 9; ++k) {
      if (!ParseReal(tokens_[k], &lattice_[k])) {
        return Fail("Lattice: " + Quoted(tokens_[k]) +
                    " is not a finite number");
      }
    }
    if (Take("pbc", &text) && !Periodicity(text)) return false;
    if (extras_ != nullptr && Take("Origin", &text)) {
      Tokens(text, &tokens_);
      extras_->origin.resize(3);
      for (int k = 0; k < 3; ++k) {
        if (tokens_.size() != 3 ||
            !ParseReal(tokens_[k], &extras_->origin[k])) {
          return Fail("Origin=" + Quoted(text) +
                      " must be three finite numbers");
        }
      }
    }
    if (!Take("Properties", &text)) return Fail("Properties=... is missing");
    return Columns(text) && FindColumns();
  }

  bool Periodicity(const std::string& text) {
    Tokens(text, &tokens_);
    const auto is = [this](const char* expected) {
      if (tokens_.size() != 3) return false;
      for (int k = 0; k < 3; ++k) {
        const char c = expected[k];
        if (tokens_[k].size() != 1 ||
            (tokens_[k][0] != c && tokens_[k][0] != (c == 'T' ? '1' : '0'))) {
          return false;
        }
      }
      return true;
    };
    if (is("TTF")) {
      dimension_ = 2;
    } else if (is("TTT") || (extras_ != nullptr && is("FFF"))) {
      dimension_ = 3;
    } else {
      return Fail("pbc=" + Quoted(text) +
                  " must be \"T T F\" (discs) or \"T T T\" (spheres)");
    }
    return true;
  }

  bool FindColumns() {
    const auto find = [this](const char* name) -> const Column* {
      for (const Column& c : columns_) {
        if (c.name == name) return &c;
      }
      return nullptr;
    };
    const auto check = [this](const Column* c, const char* as) {
      const std::string expected = as;
      if (c == nullptr) return true;
      const std::string actual =
          c->name + ":" + c->type + ":" + std::to_string(c->count);
      return actual == expected ||
             Fail("Properties: " + Quoted(actual) + " must be " + expected);
    };
    species_ = find("species");
    position_ = find("pos");
    low_ = find("pos_lo");
    radius_ = find("radius");
    stiffness_ = find("stiffness");
    velocity_ = extras_ != nullptr ? find("velo") : nullptr;
    if (position_ == nullptr) return Fail("Properties has no column pos:R:3");
    if (radius_ == nullptr) return Fail("Properties has no column radius:R:1");
    return check(species_, "species:S:1") && check(position_, "pos:R:3") &&
           check(low_, "pos_lo:R:3") && check(radius_, "radius:R:1") &&
           check(stiffness_, "stiffness:R:1") && check(velocity_, "velo:R:3");
  }

  // Before memory is taken.
  bool FitsTheText() {
    // Every row takes at least two bytes a column, the last line one less.
    const std::size_t left = text_.size() - at_;
    if (static_cast<unsigned long long>(count_) >
        (left + 1) / (2ULL * static_cast<unsigned long long>(total_)) + 1) {
      line_number_ = 1;
      return Fail(std::to_string(count_) + " grains are declared, but only " +
                  std::to_string(left) + " bytes of rows follow");
    }
    return count_ <= std::numeric_limits<int>::max() ||
           Fail(std::to_string(count_) + " grains are too many");
  }

  bool Rows() {
    const int n = static_cast<int>(count_);
    x_.resize(3, n);
    if (low_ != nullptr) x_low_.resize(3, n);
    result_.radii.resize(n);
    if (species_ != nullptr) result_.species.resize(n);
    if (stiffness_ != nullptr) result_.stiffness.resize(n);
    if (velocity_ != nullptr) extras_->velocities.resize(3, n);
    std::string_view line;
    for (int i = 0; i < n; ++i) {
      if (!NextLine(&line)) {
        return Fail("the file ends after " + std::to_string(i) + " of " +
                    std::to_string(n) + " rows");
      }
      Tokens(line, &tokens_);
      if (!Row(i)) return false;
    }
    while (NextLine(&line)) {
      Tokens(line, &tokens_);
      if (!tokens_.empty()) {
        return Fail("more rows than the " + std::to_string(n) +
                    " declared, or a second frame: " + Quoted(line));
      }
    }
    return true;
  }

  bool Real(const Column* c, int k, double* value) {
    const std::string_view token = tokens_[c->first + k];
    return ParseReal(token, value) ||
           Fail(c->name + " = " + Quoted(token) + " is not a finite number");
  }

  bool Positive(const Column* c, double* value) {
    return Real(c, 0, value) &&
           (*value > 0.0 || Fail(c->name + " = " + Quoted(tokens_[c->first]) +
                                 " must be positive"));
  }

  bool Row(int i) {
    if (static_cast<int>(tokens_.size()) != total_) {
      return Fail("row has " + std::to_string(tokens_.size()) +
                  " columns, not " + std::to_string(total_));
    }
    for (int k = 0; k < 3; ++k) {
      if (!Real(position_, k, &x_(k, i))) return false;
      if (low_ != nullptr && !Real(low_, k, &x_low_(k, i))) return false;
      if (velocity_ != nullptr &&
          !Real(velocity_, k, &extras_->velocities(k, i))) {
        return false;
      }
    }
    if (!Positive(radius_, &result_.radii[i])) return false;
    if (stiffness_ != nullptr && !Positive(stiffness_, &result_.stiffness[i])) {
      return false;
    }
    if (species_ != nullptr) {
      result_.species[i] = std::string(tokens_[species_->first]);
    }
    return dimension_ != 2 || x_(2, i) == x_(2, 0) ||
           Fail("z = " + Quoted(tokens_[position_->first + 2]) +
                " differs from the first grain's, but pbc says \"T T F\"");
  }

  bool Cell() {
    line_number_ = header_line_;
    if (dimension_ == 0) {
      dimension_ = (x_.row(2).array() == x_(2, 0)).all() ? 2 : 3;
    }
    if (dimension_ == 2 && (lattice_[2] != 0.0 || lattice_[5] != 0.0)) {
      return Fail(
          "the first two edges of a cell of discs must lie in the plane");
    }
    SmallMatrix edges(dimension_, dimension_);
    for (int edge = 0; edge < dimension_; ++edge) {
      for (int k = 0; k < dimension_; ++k) {
        edges(k, edge) = lattice_[3 * edge + k];
      }
    }
    result_.box = Box(edges);
    if (!result_.box.IsValid()) return Fail("Lattice: the cell is singular");
    result_.positions = x_.topRows(dimension_);
    return true;
  }

  // Low parts as large as an ulp of the high part.
  void CarryOver() {
    result_.positions_low = x_low_.topRows(dimension_);
    for (int i = 0; i < result_.size(); ++i) {
      for (int k = 0; k < dimension_; ++k) {
        const DoubleDouble given = result_.Position(i, k);
        if (given.Value() != given.hi) {
          result_.SetPosition(i, k, TwoSum(given.hi, given.lo));
        }
      }
    }
    if (result_.positions_low.isZero(0.0)) result_.positions_low.resize(0, 0);
  }

  const std::string& text_;
  const std::string name_;
  FrameExtras* const extras_;
  std::size_t at_ = 0;
  int line_number_ = 0;
  std::string error_;

  std::vector<std::string_view> tokens_;  // of the line at hand
  long long count_ = 0;
  int header_line_ = 0;
  double lattice_[9] = {};
  int dimension_ = 0;  // 0: not known yet
  std::vector<Column> columns_;
  int total_ = 0;  // of their widths
  // Among them; null: not there.
  const Column* species_ = nullptr;
  const Column* position_ = nullptr;
  const Column* low_ = nullptr;
  const Column* radius_ = nullptr;
  const Column* stiffness_ = nullptr;
  const Column* velocity_ = nullptr;
  Eigen::MatrixXd x_, x_low_;  // 3 x N
  Packing result_;
};

// " %.17g" in any locale.
void AppendReal(double value, std::string* out) {
  char buffer[32];
  const auto result = std::to_chars(
      buffer, buffer + sizeof(buffer), value, std::chars_format::general, 17);
  *out += ' ';
  out->append(buffer, result.ptr);
}

// Quoted where the format asks for it.
std::string AttributeWord(const std::string& text) {
  if (!text.empty() &&
      text.find_first_of(" \t\r\n=\",[]{}\\") == std::string::npos) {
    return text;
  }
  std::string word = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') word += '\\';
    if (c == '\n') {
      word += "\\n";
    } else {
      word += c;
    }
  }
  return word + '"';
}

// False, and why, for what ParsePacking() would not read back as it is.
bool CanBeWritten(const Packing& packing, std::string* problem) {
  if (!packing.IsValid(problem)) return false;
  for (std::size_t i = 0; i < packing.species.size(); ++i) {
    const std::string& species = packing.species[i];
    if (species.empty() ||
        species.find_first_of(" \t\r\n") != std::string::npos) {
      *problem = "grain " + std::to_string(i) +
                 ": species = " + Quoted(species) + " must be one word";
      return false;
    }
  }
  for (const auto& attribute : packing.attributes) {
    for (const char* taken : {"", "Lattice", "Properties", "pbc"}) {
      if (attribute.first == taken) {
        *problem = "an attribute cannot be named " + Quoted(taken);
        return false;
      }
    }
  }
  return true;
}

}  // namespace

bool ParsePacking(const std::string& text,
                  const std::string& name,
                  Packing* packing,
                  std::string* error) {
  return Parser(text, name).Parse(packing, error);
}

bool ParseFrame(const std::string& text,
                const std::string& name,
                Packing* packing,
                FrameExtras* extras,
                std::string* error) {
  *extras = FrameExtras();
  return Parser(text, name, extras).Parse(packing, error);
}

bool ReadPacking(const std::string& path,
                 Packing* packing,
                 std::string* error) {
  std::string text;
  return ReadFile(path, &text, error) &&
         ParsePacking(text, path, packing, error);
}

std::string FormatPacking(const Packing& packing,
                          const std::vector<GrainVectors>& vectors) {
  const int n = packing.size();
  const int d = packing.dimension();
  const bool low =
      packing.positions_low.size() > 0 && !packing.positions_low.isZero(0.0);
  const bool stiffness = packing.stiffness.size() > 0;
  // A cell of discs is as thick as its largest disc.
  const double thickness = std::min(2.0 * packing.radii.maxCoeff(),
                                    std::numeric_limits<double>::max());
  std::string out = std::to_string(n) + "\nLattice=\"";
  for (int edge = 0; edge < 3; ++edge) {
    for (int k = 0; k < 3; ++k) {
      const bool inside = edge < d && k < d;
      const double value = inside      ? packing.box.edges()(k, edge)
                           : edge == k ? thickness
                                       : 0.0;
      AppendReal(value, &out);
      if (edge == 0 && k == 0) out.erase(out.rfind(' '), 1);
    }
  }
  out += "\" Properties=species:S:1:pos:R:3:radius:R:1";
  if (low) out += ":pos_lo:R:3";
  if (stiffness) out += ":stiffness:R:1";
  for (const GrainVectors& column : vectors) out += ":" + column.name + ":R:3";
  out += d == 2 ? " pbc=\"T T F\"" : " pbc=\"T T T\"";
  for (const auto& attribute : packing.attributes) {
    out += " " + AttributeWord(attribute.first) + "=" +
           AttributeWord(attribute.second);
  }
  out += "\n";
  for (int i = 0; i < n; ++i) {
    out += packing.species.empty() ? "A" : packing.species[i];
    for (int k = 0; k < 3; ++k) {
      AppendReal(k < d ? packing.positions(k, i) : 0.0, &out);
    }
    AppendReal(packing.radii[i], &out);
    if (low) {
      for (int k = 0; k < 3; ++k) {
        AppendReal(k < d ? packing.positions_low(k, i) : 0.0, &out);
      }
    }
    if (stiffness) AppendReal(packing.stiffness[i], &out);
    for (const GrainVectors& column : vectors) {
      for (int k = 0; k < 3; ++k) {
        const double value = k < d ? (*column.values)(k, i) : 0.0;
        out += value == 0.0 ? " 0" : Format(" %.9g", value);
      }
    }
    out += '\n';
  }
  return out;
}

bool WritePacking(const std::string& path,
                  const Packing& packing,
                  std::string* error) {
  std::string problem;
  if (!CanBeWritten(packing, &problem)) {
    *error = path + ": not written: " + problem;
    return false;
  }
  return WriteFileAtomically(path, FormatPacking(packing), error);
}

}  // namespace granopt
