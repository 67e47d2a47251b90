# For Doxygen: comments of headers, which are plain ones, as documentation.
#
#   // text            a comment on what follows       ///
#   int x;  // text    a comment on what is before     ///<
#   //   formula       indented further: as it is      a code block
#
# The first line of a file says what the file is.

function Plain(text) {
  gsub(/&/, "\\&amp;", text)
  gsub(/</, "\\&lt;", text)
  gsub(/>/, "\\&gt;", text)
  gsub(/[\\@#]/, "\\\\&", text)
  return text
}
function CloseFormula() {
  if (formula) print indent "/// </pre>"
  formula = 0
}

NR == 1 && /^\/\/ / {
  print "/// @file"
  print "/// " Plain(substr($0, 4))
  next
}
/^[ \t]*\/\// {
  match($0, /^[ \t]*/)
  indent = substr($0, 1, RLENGTH)
  text = substr($0, RLENGTH + 3)
  item = text ~ /^ +([-*]|[0-9]+\.) /
  if (item) list = 1
  if (text ~ /^ ?$/) list = 0
  if (!list && text ~ /^   /) {
    if (!formula) {
      print indent "/// <pre>"
      formula = 1
    }
    print indent "/// " Plain(text)
    next
  }
  CloseFormula()
  print indent "///" Plain(text)
  next
}
{
  CloseFormula()
  list = 0
  at = match($0, /[^ \t].*[ \t]\/\/ /)
  if (at && $0 !~ /"[^"]*\/\/[^"]*"/) {
    split_at = index($0, "// ")
    print substr($0, 1, split_at - 1) "///< " Plain(substr($0, split_at + 3))
    next
  }
  print
}
END { CloseFormula() }
