//! Elements of a page that always close and always escape their text.

use std::fmt::{Display, Write as _};

use crate::draw::text::visible;

/// Elements that have no content and no end tag in HTML.
const VOID: &[&str] = &["meta", "br", "hr", "col"];

/// An HTML or SVG element under construction.
#[derive(Clone, Debug)]
#[must_use]
pub struct Element {
    name: &'static str,
    attributes: String,
    content: String,
}

/// An element.
pub fn el(name: &'static str) -> Element {
    Element {
        name,
        attributes: String::new(),
        content: String::new(),
    }
}

impl Element {
    /// Adds an attribute.
    pub fn attr(mut self, name: &str, value: impl Display) -> Self {
        let value = escape(&visible(&value.to_string()));
        // Writing to a String cannot fail.
        let _ = write!(self.attributes, " {name}=\"{value}\"");
        self
    }

    /// Sets the class (once per element).
    pub fn class(self, class: &str) -> Self {
        self.attr("class", class)
    }

    /// Adds text.
    pub fn text(mut self, text: impl Display) -> Self {
        self.content.push_str(&escape(&visible(&text.to_string())));
        self
    }

    /// Adds text whose line ends stay.
    pub fn lines(mut self, text: &str) -> Self {
        self.content
            .push_str(&escape(&crate::draw::text::visible_lines(text)));
        self
    }

    /// Adds a child.
    pub fn child(mut self, child: Self) -> Self {
        child.write_to(&mut self.content);
        self
    }

    /// Adds children.
    pub fn children(mut self, children: impl IntoIterator<Item = Self>) -> Self {
        for child in children {
            child.write_to(&mut self.content);
        }
        self
    }

    /// The style sheet: the one text that must not be escaped. It is ours.
    pub fn style_sheet(css: &'static str) -> Self {
        let mut style = el("style");
        style.content.push_str(css);
        style
    }

    /// A script of ours, as it stands: the page's policy names it by its hash.
    pub fn script(text: &'static str) -> Self {
        let mut script = el("script");
        script.content.push_str(text);
        script
    }

    fn write_to(&self, out: &mut String) {
        let Self {
            name,
            attributes,
            content,
        } = self;
        // Writing to a String cannot fail.
        let _ = if VOID.contains(name) {
            writeln!(out, "<{name}{attributes}/>")
        } else if is_inline(name) {
            write!(out, "<{name}{attributes}>{content}</{name}>")
        } else {
            writeln!(out, "<{name}{attributes}>{content}</{name}>")
        };
    }
}

impl Display for Element {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut out = String::new();
        self.write_to(&mut out);
        f.write_str(&out)
    }
}

/// Elements inside running text, where a line end would show as a space.
fn is_inline(name: &str) -> bool {
    matches!(
        name,
        "span" | "b" | "i" | "a" | "sub" | "sup" | "code" | "tspan" | "pre" | "title"
    )
}

/// Escapes text for content and for attributes in double quotes.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            other => out.push(other),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Text cannot leave its element, an attribute cannot leave its quotes.
    #[test]
    fn text_and_attributes_are_escaped() {
        let made = el("b")
            .attr("title", "\"><script>'")
            .text("</b>&")
            .to_string();
        assert_eq!(
            made,
            "<b title=\"&quot;&gt;&lt;script&gt;&#39;\">&lt;/b&gt;&amp;</b>"
        );
    }
}
