"""Published results reproduced: studies of `config/validation`, compared with the literature in
docs/validation.md.
"""
