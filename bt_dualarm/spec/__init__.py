"""From the text of a tree file to what it means, or to everything that is wrong with it.

In: a file, YAML text or Python data; the skills that there are, by what they declare.
Out: frozen models of world, objects and arms with one tree of nodes an arm; or problems, each with
its place, what was given and what is allowed. The schema and the reference come from here, too.
Open first: `load` (the steps in their order); others: `reader` (strict YAML: no duplicate keys),
`word` and `language` (the words), `ports`, `color` (HSV, the hue wraps around at red).
"""
