#include "experiments/tabular.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <set>

#include "solvers/format.h"

namespace granopt {

bool Fail(const std::string& line, std::string* error) {
  *error = line;
  return false;
}

bool ParseDouble(const std::string& text, double* value) {
  char* end = nullptr;
  *value = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0';
}

bool ParseInteger(const std::string& text, std::int64_t* value) {
  char* end = nullptr;
  errno = 0;
  *value = std::strtoll(text.c_str(), &end, 10);
  return !text.empty() && *end == '\0' && errno == 0;
}

std::string Trimmed(const std::string& text) {
  const std::size_t first = text.find_first_not_of(' ');
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(' ') - first + 1);
}

std::vector<std::string> Split(const std::string& text, char separator) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == separator)
      parts.emplace_back();
    else
      parts.back() += c;
  }
  for (std::string& part : parts) part = Trimmed(part);
  return parts;
}

bool ParseNumbers(const std::string& text, std::vector<double>* values) {
  values->clear();
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    double value;
    if (!ParseDouble(text.substr(at, end - at), &value) ||
        !std::isfinite(value)) {
      return false;
    }
    values->push_back(value);
    at = end + 1;
  }
  return true;
}

bool ParsePositives(const std::string& text,
                    std::vector<double>* numbers,
                    std::string* error) {
  numbers->clear();
  for (const std::string& entry : Split(text, ',')) {
    double value = 0.0;
    if (!ParseDouble(entry, &value) || !(value > 0.0) ||
        !std::isfinite(value)) {
      return Fail("'" + entry + "' is not a positive number", error);
    }
    if (std::count(numbers->begin(), numbers->end(), value) > 0) {
      return Fail("'" + entry + "' is given twice", error);
    }
    numbers->push_back(value);
  }
  return true;
}

bool ParseSeeds(const std::string& text,
                std::vector<std::uint64_t>* seeds,
                std::string* error) {
  constexpr std::uint64_t kMost = 100000;
  seeds->clear();
  std::set<std::uint64_t> known;
  for (const std::string& entry : Split(text, ',')) {
    const std::size_t dash = entry.find('-');
    std::int64_t first = -1, last = -1;
    if (!ParseInteger(entry.substr(0, dash), &first) || first < 0)
      last = -1;
    else if (dash == std::string::npos)
      last = first;
    else if (!ParseInteger(entry.substr(dash + 1), &last))
      last = -1;
    if (first < 0 || last < first ||
        seeds->size() + static_cast<std::uint64_t>(last - first) >= kMost) {
      return Fail("'" + entry + "' is no seed and no range of seeds like 1-3",
                  error);
    }
    // Counted from 0: the last seed may be the largest integer.
    for (std::int64_t k = 0; k <= last - first; ++k) {
      const std::uint64_t seed = static_cast<std::uint64_t>(first + k);
      if (!known.insert(seed).second) {
        return Fail("seed " + std::to_string(seed) + " is given twice", error);
      }
      seeds->push_back(seed);
    }
  }
  return true;
}

// ---------------------------------------------------------------- CSV

std::string Field(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + "\"";
}

std::string Number(double value, int digits) {
  return Format("%.*g", digits, value);
}
std::string Number(std::int64_t value) {
  return Format("%lld", static_cast<long long>(value));
}

std::string Neat(double value) {
  const double size = std::abs(value);
  const bool scientific = size > 0.0 && (size < 0.1 || size >= 1e6);
  std::string text;
  for (int digits = 1; digits <= 17; ++digits) {
    text = scientific ? Format("%.*e", digits - 1, value)
                      : Format("%.*g", std::max(digits, 6), value);
    if (std::strtod(text.c_str(), nullptr) == value) break;
  }
  const std::size_t e = text.find('e');
  if (e == std::string::npos) return text;
  const int exponent = std::atoi(text.c_str() + e + 1);
  return text.substr(0, e + 1) + std::to_string(exponent);
}

std::string NumbersCsv(const std::vector<std::string>& columns,
                       const std::vector<std::vector<double>>& rows) {
  std::string csv;
  for (const std::string& name : columns) {
    csv += (csv.empty() ? "" : ",") + name;
  }
  csv += "\n";
  for (const std::vector<double>& row : rows) {
    for (std::size_t k = 0; k < row.size(); ++k) {
      csv += (k == 0 ? "" : ",") + Number(row[k]);
    }
    csv += "\n";
  }
  return csv;
}

bool CsvReader::Begin(std::string* error) {
  std::vector<std::string> names;
  if (!Next(&names)) return Fail(name_ + ": empty", error);
  for (std::size_t k = 0; k < names.size(); ++k) columns_[names[k]] = k;
  return true;
}

bool CsvReader::Row() {
  while (Next(&row_)) {
    if (row_.size() > 1 || !row_[0].empty()) return true;
  }
  return false;
}

void CsvReader::Read(const char* column, std::string* value) {
  const auto found = columns_.find(column);
  if (found == columns_.end()) {
    Complain(1, std::string("no column ") + column);
  } else if (found->second >= row_.size()) {
    Complain(line_,
             Format("%zu columns, expected %zu", row_.size(), columns_.size()));
  } else {
    *value = row_[found->second];
  }
}

void CsvReader::Read(const char* column, double* value) {
  std::string text;
  Read(column, &text);
  if (!ParseDouble(text, value)) NotNumber(column, text);
}

void CsvReader::Read(const char* column, std::int64_t* value) {
  std::string text;
  Read(column, &text);
  if (!ParseInteger(text, value)) NotNumber(column, text);
}

void CsvReader::Read(const char* column, int* value) {
  std::int64_t wide = 0;
  Read(column, &wide);
  *value = static_cast<int>(wide);
  if (*value != wide) NotNumber(column, std::to_string(wide));
}

void CsvReader::Read(const char* column, std::uint64_t* value) {
  std::string text;
  Read(column, &text);
  char* end = nullptr;
  errno = 0;
  *value = std::strtoull(text.c_str(), &end, 10);
  if (text.empty() || text[0] == '-' || *end != '\0' || errno != 0) {
    NotNumber(column, text);
  }
}

void CsvReader::Read(const char* column, bool* value) {
  int number = 0;
  Read(column, &number);
  *value = number != 0;
}

void CsvReader::NotNumber(const char* column, const std::string& text) {
  Complain(line_, std::string(column) + ": '" + text + "' is not a number");
}

void CsvReader::Complain(int line, const std::string& what) {
  if (error_.empty()) error_ = Format("%s:%d: ", name_.c_str(), line) + what;
}

bool CsvReader::Next(std::vector<std::string>* fields) {
  if (at_ >= text_.size()) return false;
  ++line_;
  fields->assign(1, "");
  bool quoted = false;
  for (; at_ < text_.size(); ++at_) {
    const char c = text_[at_];
    if (quoted) {
      if (c != '"') {
        fields->back() += c;
      } else if (at_ + 1 < text_.size() && text_[at_ + 1] == '"') {
        fields->back() += text_[++at_];
      } else {
        quoted = false;
      }
    } else if (c == '"') {
      quoted = true;
    } else if (c == ',') {
      fields->emplace_back();
    } else if (c == '\n') {
      ++at_;
      return true;
    } else if (c != '\r') {
      fields->back() += c;
    }
  }
  return true;
}

void CsvColumns::Add(const char* name, std::string* value) {
  if (reader_ != nullptr)
    reader_->Read(name, value);
  else
    Write(name, Field(*value));
}

void CsvColumns::Add(const char* name, int* value) {
  if (reader_ != nullptr)
    reader_->Read(name, value);
  else
    Write(name, Number(std::int64_t{*value}));
}

void CsvColumns::Add(const char* name, std::int64_t* value) {
  if (reader_ != nullptr)
    reader_->Read(name, value);
  else
    Write(name, Number(*value));
}

void CsvColumns::Add(const char* name, std::uint64_t* value) {
  if (reader_ != nullptr)
    reader_->Read(name, value);
  else
    Write(name, std::to_string(*value));
}

void CsvColumns::Add(const char* name, bool* value) {
  if (reader_ != nullptr)
    reader_->Read(name, value);
  else
    Write(name, *value ? "1" : "0");
}

void CsvColumns::Add(const char* name,
                     double* value,
                     std::string (*print)(double)) {
  if (reader_ != nullptr)
    reader_->Read(name, value);
  else
    Write(name, print(*value));
}

void CsvColumns::Add(const char* name, double* value, int digits) {
  if (reader_ != nullptr)
    reader_->Read(name, value);
  else
    Write(name, Number(*value, digits));
}

void CsvColumns::Write(const char* name, const std::string& field) {
  const char* const comma = header_.empty() ? "" : ",";
  header_ += comma + std::string(name);
  row_ += comma + field;
}

// ---------------------------------------------------------------- text

int Width(const std::string& text) {
  int width = 0;
  for (const char c : text) width += (static_cast<unsigned char>(c) >> 6) != 2;
  return width;
}

std::string Grid(const std::vector<std::vector<std::string>>& rows,
                 int words,
                 bool markdown,
                 int names) {
  const int columns = static_cast<int>(rows[0].size());
  std::vector<int> width(columns, 0);
  for (const auto& row : rows) {
    for (int c = 0; c < columns; ++c) {
      width[c] = std::max(width[c], Width(row[c]));
    }
  }
  std::string text;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    std::string line = markdown ? "|" : "   ";
    for (int c = 0; c < columns; ++c) {
      const std::string& word = rows[r][c];
      if (markdown) {
        line += " ";
        for (const char ch : word)
          line += ch == '|' ? "\\|" : std::string(1, ch);
        line += " |";
        continue;
      }
      const std::string air(width[c] - Width(word), ' ');
      const bool left = c < names || c >= columns - words;
      line += (c == 0 ? " " : "  ") + (left ? word + air : air + word);
    }
    text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
    if (markdown && r == 0) {
      text += "|";
      for (int c = 0; c < columns; ++c) {
        text += c < names || c >= columns - words ? " --- |" : " ---: |";
      }
      text += "\n";
    }
  }
  return text;
}

std::string Count(double value) {
  return std::isinf(value) ? "never" : Format("%.0f", value);
}
std::string Seconds(double value) {
  return std::isinf(value) ? "never" : Format("%.3g", value);
}
std::string Ratio(double value) {
  return std::isinf(value) ? "never"
                           : Format(value < 0.095 ? "%.2g" : "%.2f", value);
}

}  // namespace granopt
