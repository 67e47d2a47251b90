#include "granular/packing_io.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include "granular/atomic_file.h"

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

  bool Columns(const std::string& properties,
               std::vector<Column>* columns,
               int* total) {
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
    *total = 0;
    for (std::size_t f = 0; f < fields.size(); f += 3) {
      long long count;
      const bool known_type = fields[f + 1].size() == 1 &&
                              std::string_view("SRIL").find(fields[f + 1]) !=
                                  std::string_view::npos;
      if (fields[f].empty() || !known_type ||
          !ParseInteger(fields[f + 2], &count) || count < 1 || count > 64 ||
          *total + count > 1024) {
        return Fail("Properties: " + Quoted(fields[f]) + ":" +
                    Quoted(fields[f + 1]) + ":" + Quoted(fields[f + 2]) +
                    " is not name:type(S, R, I, L):columns");
      }
      for (const Column& other : *columns) {
        if (other.name == fields[f]) {
          return Fail("Properties: " + Quoted(fields[f]) + " is given twice");
        }
      }
      columns->push_back({std::string(fields[f]),
                          fields[f + 1][0],
                          *total,
                          static_cast<int>(count)});
      *total += static_cast<int>(count);
    }
    return true;
  }

  bool Frame(Packing* packing) {
    std::string_view line;
    std::vector<std::string_view> tokens;
    if (!NextLine(&line)) {
      line_number_ = 1;
      return Fail("the file is empty");
    }
    Tokens(line, &tokens);
    long long count = 0;
    if (tokens.size() != 1 || !ParseInteger(tokens[0], &count) || count < 1) {
      return Fail("the number of grains must be a positive integer, not " +
                  Quoted(line));
    }

    if (!NextLine(&line)) {
      return Fail("the file ends before the comment line");
    }
    Packing result;
    if (!Attributes(line, &result.attributes)) return false;
    const auto take = [&result](const char* key, std::string* value) {
      const auto found = result.attributes.find(key);
      if (found == result.attributes.end()) return false;
      *value = found->second;
      result.attributes.erase(found);
      return true;
    };
    std::string text;
    if (!take("Lattice", &text)) return Fail("Lattice=\"...\" is missing");
    Tokens(text, &tokens);
    double lattice[9];
    if (tokens.size() != 9) {
      return Fail("Lattice has " + std::to_string(tokens.size()) +
                  " numbers, not 9");
    }
    for (int k = 0; k < 9; ++k) {
      if (!ParseReal(tokens[k], &lattice[k])) {
        return Fail("Lattice: " + Quoted(tokens[k]) +
                    " is not a finite number");
      }
    }
    int dimension = 0;  // not known yet
    if (take("pbc", &text)) {
      Tokens(text, &tokens);
      const auto is = [&](std::size_t k, char c) {
        return tokens[k].size() == 1 &&
               (tokens[k][0] == c || tokens[k][0] == (c == 'T' ? '1' : '0'));
      };
      if (tokens.size() == 3 && is(0, 'T') && is(1, 'T') && is(2, 'F')) {
        dimension = 2;
      } else if (tokens.size() == 3 && is(0, 'T') && is(1, 'T') && is(2, 'T')) {
        dimension = 3;
      } else if (extras_ != nullptr && tokens.size() == 3 && is(0, 'F') &&
                 is(1, 'F') && is(2, 'F')) {
        dimension = 3;
      } else {
        return Fail("pbc=" + Quoted(text) +
                    " must be \"T T F\" (discs) or \"T T T\" (spheres)");
      }
    }
    if (extras_ != nullptr && take("Origin", &text)) {
      Tokens(text, &tokens);
      extras_->origin.resize(3);
      for (int k = 0; k < 3; ++k) {
        if (tokens.size() != 3 || !ParseReal(tokens[k], &extras_->origin[k])) {
          return Fail("Origin=" + Quoted(text) +
                      " must be three finite numbers");
        }
      }
    }
    if (!take("Properties", &text)) return Fail("Properties=... is missing");
    std::vector<Column> columns;
    int total = 0;
    if (!Columns(text, &columns, &total)) return false;
    const int header_line = line_number_;
    const auto find = [&columns](const char* name) -> const Column* {
      for (const Column& c : columns) {
        if (c.name == name) return &c;
      }
      return nullptr;
    };
    const Column* species = find("species");
    const Column* position = find("pos");
    const Column* low = find("pos_lo");
    const Column* radius = find("radius");
    const Column* stiffness = find("stiffness");
    const Column* velocity = extras_ != nullptr ? find("velo") : nullptr;
    const auto check = [this](const Column* c, const char* as) {
      const std::string expected = as;
      if (c == nullptr) return true;
      const std::string actual =
          c->name + ":" + c->type + ":" + std::to_string(c->count);
      return actual == expected ||
             Fail("Properties: " + Quoted(actual) + " must be " + expected);
    };
    if (position == nullptr) return Fail("Properties has no column pos:R:3");
    if (radius == nullptr) return Fail("Properties has no column radius:R:1");
    if (!check(species, "species:S:1") || !check(position, "pos:R:3") ||
        !check(low, "pos_lo:R:3") || !check(radius, "radius:R:1") ||
        !check(stiffness, "stiffness:R:1") || !check(velocity, "velo:R:3")) {
      return false;
    }
    // Every row takes at least two bytes a column, the last line one less.
    const std::size_t left = text_.size() - at_;
    if (static_cast<unsigned long long>(count) >
        (left + 1) / (2ULL * static_cast<unsigned long long>(total)) + 1) {
      line_number_ = 1;
      return Fail(std::to_string(count) + " grains are declared, but only " +
                  std::to_string(left) + " bytes of rows follow");
    }

    const int n = static_cast<int>(
        std::min<long long>(count, std::numeric_limits<int>::max()));
    if (n != count) return Fail(std::to_string(count) + " grains are too many");
    Eigen::MatrixXd x(3, n), x_low;
    if (low != nullptr) x_low.resize(3, n);
    result.radii.resize(n);
    if (species != nullptr) result.species.resize(n);
    if (stiffness != nullptr) result.stiffness.resize(n);
    if (velocity != nullptr) extras_->velocities.resize(3, n);
    for (int i = 0; i < n; ++i) {
      if (!NextLine(&line)) {
        return Fail("the file ends after " + std::to_string(i) + " of " +
                    std::to_string(n) + " rows");
      }
      Tokens(line, &tokens);
      if (static_cast<int>(tokens.size()) != total) {
        return Fail("row has " + std::to_string(tokens.size()) +
                    " columns, not " + std::to_string(total));
      }
      const auto real = [&](const Column* c, int k, double* value) {
        const std::string_view token = tokens[c->first + k];
        return ParseReal(token, value) || Fail(c->name + " = " + Quoted(token) +
                                               " is not a finite number");
      };
      for (int k = 0; k < 3; ++k) {
        if (!real(position, k, &x(k, i))) return false;
        if (low != nullptr && !real(low, k, &x_low(k, i))) return false;
        if (velocity != nullptr &&
            !real(velocity, k, &extras_->velocities(k, i))) {
          return false;
        }
      }
      if (!real(radius, 0, &result.radii[i])) return false;
      if (!(result.radii[i] > 0.0)) {
        return Fail("radius = " + Quoted(tokens[radius->first]) +
                    " must be positive");
      }
      if (stiffness != nullptr) {
        if (!real(stiffness, 0, &result.stiffness[i])) return false;
        if (!(result.stiffness[i] > 0.0)) {
          return Fail("stiffness = " + Quoted(tokens[stiffness->first]) +
                      " must be positive");
        }
      }
      if (species != nullptr) {
        result.species[i] = std::string(tokens[species->first]);
      }
      if (dimension == 2 && x(2, i) != x(2, 0)) {
        return Fail("z = " + Quoted(tokens[position->first + 2]) +
                    " differs from the first grain's, but pbc says \"T T F\"");
      }
    }
    while (NextLine(&line)) {
      Tokens(line, &tokens);
      if (!tokens.empty()) {
        return Fail("more rows than the " + std::to_string(n) +
                    " declared, or a second frame: " + Quoted(line));
      }
    }
    line_number_ = header_line;
    if (dimension == 0) {
      dimension = (x.row(2).array() == x(2, 0)).all() ? 2 : 3;
    }
    if (dimension == 2 && (lattice[2] != 0.0 || lattice[5] != 0.0)) {
      return Fail(
          "the first two edges of a cell of discs must lie in the plane");
    }
    SmallMatrix edges(dimension, dimension);
    for (int edge = 0; edge < dimension; ++edge) {
      for (int k = 0; k < dimension; ++k)
        edges(k, edge) = lattice[3 * edge + k];
    }
    result.box = Box(edges);
    if (!result.box.IsValid()) {
      return Fail("Lattice: the cell is singular");
    }
    result.positions = x.topRows(dimension);
    if (low != nullptr) {
      result.positions_low = x_low.topRows(dimension);
      for (int i = 0; i < n; ++i) {
        for (int k = 0; k < dimension; ++k) {
          // Low parts as large as an ulp of the high part are carried over.
          const DoubleDouble given = result.Position(i, k);
          if (given.Value() != given.hi) {
            result.SetPosition(i, k, TwoSum(given.hi, given.lo));
          }
        }
      }
      if (result.positions_low.isZero(0.0)) result.positions_low.resize(0, 0);
    }
    std::string problem;
    if (!result.IsValid(&problem)) return Fail(problem);
    *packing = std::move(result);
    return true;
  }

  const std::string& text_;
  const std::string name_;
  FrameExtras* const extras_;
  std::size_t at_ = 0;
  int line_number_ = 0;
  std::string error_;
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

std::string FormatPacking(const Packing& packing) {
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
