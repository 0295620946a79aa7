"""What has to be so before anything flies.

machine: what this computer lacks for a configuration. checks: one a file, pure, over `facts`; policy: which
parameters of which firmware say what the configuration declares; fence: its corners;
waivers: what an operator takes upon himself; conduct: asks the vehicles, and judges. Nothing here arms.
"""
